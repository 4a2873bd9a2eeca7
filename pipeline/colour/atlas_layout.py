"""Layout of a texture atlas: affine charts, the shared frame layer, and packed rectangles."""

from dataclasses import dataclass

import numpy as np

from ..camera.pinhole import PinholeCamera
from ..errors import InputError
from ..projection.rasteriser import barycentric, nearest_barycentric, rasterise
from .source_view import TOLERANCE_PX

GUTTER = 1.02
"""Half-width of the margin around each face, texels: 1 for bilinear lookups, the rest for rounding of float32 UV."""

AFFINE_ERROR_PX = 0.05
"""Faces whose projection deviates more than this from affine interpolation of their corners leave the frame layer."""

SUPERSAMPLING = 2.0
"""Texels per frame pixel, where those are densest, on faces that are resampled because of perspective."""

MAX_DEPTH_RATIO = 4.0
"""Largest ratio of depths inside a face that the resampling accounts for."""

SAME_DEPTH_PX = 0.01
"""Two faces that contain the same texel centre at depths differing by more, in pixel footprints, are two surfaces."""


@dataclass(frozen=True)
class Charts:
    """Affine maps of S faces to texels, each up to an integer translation.

    Attributes
    ----------
    texels
        ``(S, 3, 2)`` corners; frame pixels where ``aligned``.
    aligned
        ``(S,)`` bool: the chart is the projection to the frame, which is nearly affine on this face.
    """

    texels: np.ndarray
    aligned: np.ndarray


@dataclass(frozen=True)
class FrameLayer:
    """The faces that share a cut-out of the frame, and the owner of each texel.

    Attributes
    ----------
    members
        ``(S,)`` bool: the faces in the layer.
    low, size
        ``(2,)`` int, first frame pixel (x, y) of the cut-out, and its width and height.
    face, x, y
        ``(N,)`` owner (index into the S faces) of each owned texel, and the texel as a frame pixel.
    """

    members: np.ndarray
    low: np.ndarray
    size: np.ndarray
    face: np.ndarray
    x: np.ndarray
    y: np.ndarray


def affine_charts(points_cam: np.ndarray, camera: PinholeCamera) -> Charts:
    """Choose a chart for each of S faces, given as ``(S, 3, 3)`` corners in the camera frame, mm.

    Notes
    -----
    The middle of an edge of depths za, zb projects |zb - za| / (2 (za + zb)) of the edge's length in pixels away from
    the middle of its projection. Faces where this exceeds :data:`AFFINE_ERROR_PX` are resampled, at a scale sufficient
    for their densest part, where the frame has up to max(z) / min(z) times the pixels of the mean. Faces that extend
    behind the camera or far out of the frame are unfolded isometrically instead.
    """
    z = points_cam[..., 2]
    reach = max(camera.size_wh)
    pixels = camera.project(points_cam)
    # NaN behind the camera compares False
    usable = ((pixels > -reach / 2) & (pixels < np.array(camera.size_wh) + reach / 2)).all(axis=(1, 2))
    texels = np.where(usable[:, None, None], pixels, 0.0)
    z_next = np.roll(z, -1, axis=1)
    edge = np.linalg.norm(np.roll(texels, -1, axis=1) - texels, axis=2)
    aligned = usable & (edge * np.abs(z_next - z) <= 2 * AFFINE_ERROR_PX * (z_next + z)).all(axis=1)
    others = np.flatnonzero(~aligned)
    if len(others):
        unrolled = ~usable[others]
        shape = np.where(unrolled[:, None, None], _unroll(points_cam[others]), texels[others])
        shape -= shape.min(axis=1, keepdims=True)
        near, far = z[others].min(axis=1), z[others].max(axis=1)
        # frame pixels per unit of the shape (mm or px) at the near end are this / near
        pixels_times_near = np.where(unrolled, max(camera.fx, camera.fy), far)
        wanted = SUPERSAMPLING * pixels_times_near / np.maximum(near, far / MAX_DEPTH_RATIO)
        scale = np.minimum(wanted, 2 * reach / shape.max(axis=(1, 2)))
        texels[others] = shape * scale[:, None, None]
    return Charts(texels, aligned)


def frame_layer(charts: Charts, depth: np.ndarray, fully: np.ndarray, camera: PinholeCamera) -> FrameLayer:
    """Keep as many aligned faces as possible in the frame layer, with one surface per texel.

    A texel belongs to the nearest face that contains its centre, else to the face that reaches it with the least
    extrapolation relative to its size. A face leaves the layer if it reads a texel whose owner has another depth there.
    If both contain the centre, the bound is :data:`SAME_DEPTH_PX`. Otherwise it is what the visibility rule allows for
    a crease, both at the texel, on the face's plane, and at the nearest point of the face, on the owner's plane.

    Parameters
    ----------
    charts
        Those of S faces.
    depth
        ``(S, 3)`` depth of the corners, mm.
    fully
        ``(S,)`` bool: the frame saw all of the face.
    """
    members = charts.aligned.copy()
    index = np.flatnonzero(members)
    if len(index) == 0:
        nothing = np.zeros(0, dtype=np.int64)
        return FrameLayer(members, np.zeros(2, np.int64), np.zeros(2, np.int64), nothing, nothing, nothing)
    triangles = charts.texels[index]
    low = np.ceil(triangles.min(axis=(0, 1)) - GUTTER).astype(np.int64)
    size = np.floor(triangles.max(axis=(0, 1)) + GUTTER).astype(np.int64) - low + 1
    pieces = []
    for samples in rasterise(triangles, margin=GUTTER):
        face = index[samples.triangle]
        texel = (samples.y - low[1]) * size[0] + samples.x - low[0]
        z = np.einsum("nk,nk->n", samples.barycentric, depth[face])
        pieces.append((face.astype(np.int32), texel.astype(np.int32), z, samples.least))
    face, texel, z, least = (np.concatenate(column) for column in zip(*pieces, strict=True))
    contains = least >= -1e-9
    score = np.where(contains, z, 2 * depth.max() - least)
    best = np.empty(int(size.prod()))
    owner = np.empty(len(best), dtype=np.int32)
    open_texels = np.ones(len(best), dtype=bool)
    while open_texels.any():
        pairs = np.flatnonzero(open_texels[texel] & members[face])
        at, of_pairs = texel[pairs], score[pairs]
        best[open_texels], owner[open_texels] = np.inf, -1
        np.minimum.at(best, at, of_pairs)
        wins = of_pairs == best[at]
        owner[at[wins]] = pairs[wins]
        winner = owner[at]
        overlap = contains[pairs] & contains[winner]
        of_winner = z[winner]
        allowed = np.where(overlap, SAME_DEPTH_PX, TOLERANCE_PX) * np.abs(of_winner) / min(camera.fx, camera.fy)
        other = np.abs(z[pairs] - of_winner) > allowed
        # at a crease the extended plane of the face leaves the surface, but the owner's plane still meets the face
        creased = np.flatnonzero(other & ~overlap & fully[face[pairs]])
        here, there, where = face[pairs[creased]], face[winner[creased]], texel[pairs[creased]]
        centres = np.stack([where % size[0] + low[0], where // size[0] + low[1]], axis=1)
        weights, _ = nearest_barycentric(charts.texels[here], centres)
        edge = np.einsum("nk,nkd->nd", weights, charts.texels[here])
        step = (weights * depth[here] - barycentric(charts.texels[there], edge) * depth[there]).sum(axis=1)
        other[creased] = np.abs(step) > allowed[creased]
        # faces behind others leave first; without them the silhouette in front may stay
        leaving = other & overlap if (other & overlap).any() else other
        members[face[pairs[leaving]]] = False
        open_texels = (owner >= 0) & ~members[face[owner]]
        open_texels[texel[pairs[other & ~leaving]]] = True
    owned = np.flatnonzero(owner >= 0)
    x, y = owned % size[0] + low[0], owned // size[0] + low[1]
    return FrameLayer(members, low, size, face[owner[owned]].astype(np.int64), x, y)


def pack_rectangles(sizes: np.ndarray, layer_size: np.ndarray, max_size: int) -> tuple[np.ndarray, tuple[int, int]]:
    """Pack ``(R, 2)`` rectangles (width, height) in shelves below the frame layer, tall ones first.

    Returns
    -------
    ``(R, 2)`` int top-left corners, and the (width, height) of the atlas.
    """
    order = np.argsort(-sizes[:, 1], kind="stable")
    ends = np.cumsum(sizes[order, 0])
    widest = int(max(sizes[:, 0].max(), layer_size[0]))
    squarish = int(np.ceil(np.sqrt(float(sizes.prod(axis=1).sum()))))
    origins = np.zeros_like(sizes)
    for width in (max(widest, min(squarish, max_size)), max_size):
        top, first = int(layer_size[1]), 0
        while first < len(order):
            used = ends[first - 1] if first else 0
            end = int(np.searchsorted(ends, used + max(width, widest), side="right"))
            shelf = order[first:end]
            origins[shelf, 0] = ends[first:end] - sizes[shelf, 0] - used
            origins[shelf, 1] = top
            top, first = top + int(sizes[shelf[0], 1]), end
        if top <= max_size:
            break
    if max(width, widest, top) > max_size:
        raise InputError(
            f"texture atlas: expected at most {max_size}x{max_size} texels, found {len(sizes)} charts that need "
            f"{max(width, widest)}x{top}; use the vertex or the projective colour mode, or a frame of fewer pixels"
        )
    return origins, (max(width, widest), top)


def _unroll(triangles: np.ndarray) -> np.ndarray:
    """``(S, 3, 3)`` triangles in space -> ``(S, 3, 2)`` congruent triangles in the plane."""
    ab, ac = triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]
    length = np.linalg.norm(ab, axis=1)
    flat = np.zeros((len(triangles), 3, 2))
    flat[:, 1, 0] = length
    flat[:, 2, 0] = (ab * ac).sum(axis=1) / length
    flat[:, 2, 1] = np.linalg.norm(np.cross(ab, ac), axis=1) / length
    return flat
