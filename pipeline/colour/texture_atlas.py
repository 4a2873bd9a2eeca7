"""Texture atlas baked from the frame: its texels are, where possible, the frame's own pixels.

The upper part of the atlas is the *frame layer*: a cut-out of the frame in which the UV of a face is its projection.
Texel centres are pixel centres there, so baking copies pixels and adds no blur. The layer holds one surface per texel.
Faces that would read texels of another surface (across a depth step, or behind it), and faces on which the projection
is not nearly affine, get separate rectangles below it. Faces that the frame did not see share a neutral patch. Several
frames have an atlas each, of the faces that those before did not see, in one image.

Every texel has a flag: whether the frame saw its point of the surface. A lookup counts as observed if all texels of
non-zero weight are, i.e. if the interpolated flag is at least 1 - 1e-4.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from ..camera.pinhole import PinholeCamera
from ..images.pixel_values import among_centres
from ..projection.rasteriser import Samples, barycentric, nearest_barycentric, rasterise
from ..surface.mesh import TriangleMesh
from ..transforms import BLOCK, camera_centre, transform_points
from .atlas_layout import GUTTER, affine_charts, frame_layer, pack_rectangles
from .source_view import SourceView
from .vertex_colours import NEUTRAL

MAX_SIZE = 16384
"""Largest width and height of an atlas, texels: the limit of common graphics cards."""

MAX_SLOPE = 16.0
"""Steepest extrapolation of a face's plane beyond its edges: depth step per texel, in pixel footprints."""

OBSERVED_LEAST = 0.9999
"""If an interpolated flag is at least this large, all values that it was interpolated from are observed."""
_ELSEWHERE = 3
"""In the place of 0, 1 and 2 of :func:`classify_faces`: the face is in the atlas of another view."""

NEUTRAL_PATCH = 4
"""Side of the patch for faces that the frame did not see, texels."""

Observed = Callable[[np.ndarray, np.ndarray], np.ndarray]
"""A visibility rule: points (N, 3) in the model frame and their unit face normals (N, 3) -> (N,) bool.

True must mean that the frame, sampled bilinearly at the point's projection, shows this point and nothing else, as
:meth:`oneframe.colour.source_view.SourceView.observed` does. Points may lie a texel outside the surface.
"""


@dataclass(frozen=True)
class TextureAtlas:
    """A texture baked from the frame, and its UV map.

    Attributes
    ----------
    uv
        ``(F, 3, 2)`` float64 per face corner, in [0, 1], origin bottom-left with v up (Blender, OBJ): the centre of
        the texel in column i and row j (from the top) is ((i + 0.5) / width, 1 - (j + 0.5) / height).
    image
        ``(h, w, C)`` float32, top row first; where not observed, a given colour, or
        :data:`oneframe.colour.vertex_colours.NEUTRAL`.
    observed
        ``(h, w)`` bool.
    faces_seen
        Number of faces that the frame saw not at all, partly, and fully.
    separate_charts
        Number of faces with a separate rectangle.
    """

    uv: np.ndarray
    image: np.ndarray
    observed: np.ndarray
    faces_seen: tuple[int, int, int]
    separate_charts: int

    def summary(self) -> str:
        """For the user: size and coverage."""
        height, width = self.observed.shape
        unseen, partly, fully = self.faces_seen
        return (
            f"texture atlas: {width}x{height} texels, {self.observed.mean():.0%} observed; {fully} faces seen fully, "
            f"{partly} partly, {unseen} not at all; {self.separate_charts} separate charts"
        )


def classify_faces(
    mesh: TriangleMesh, camera: PinholeCamera, cam_from_model: np.ndarray, observed: Observed
) -> np.ndarray:
    """How much of each face the frame saw: ``(F,)`` uint8, 0 nothing, 1 a part, 2 all.

    Tests the corners, edge midpoints and centroid, and a grid as fine as the frame's pixels. Faces that face away from
    the camera or lie outside the frame are 0 without a test.
    """
    faces = np.flatnonzero(mesh.front_facing(camera_centre(cam_from_model)))
    vertices_cam = transform_points(cam_from_model, mesh.vertices)
    # a NaN (behind the camera) compares False, so those faces are kept
    u, v = camera.project(vertices_cam).T
    width, height = camera.size_wh
    all_outside = (u < -0.5, u > width - 0.5, v < -0.5, v > height - 0.5, ~(vertices_cam[:, 2] > 0))
    a, b, c = mesh.faces[faces].T
    kept = np.ones(len(faces), dtype=bool)
    for outside in all_outside:
        kept &= ~(outside[a] & outside[b] & outside[c])
    faces = faces[kept]
    points_cam = vertices_cam[mesh.faces[faces]]
    corners, normals = mesh.vertices[mesh.faces[faces]], mesh.face_normals[faces]
    passed = np.zeros(len(faces), dtype=bool)
    failed = np.zeros(len(faces), dtype=bool)

    def test(index: np.ndarray, weights: np.ndarray) -> None:
        flags = observed(np.einsum("nk,nkd->nd", weights, corners[index]), normals[index])
        passed[index[flags]] = True
        failed[index[~flags]] = True

    halves = (np.ones((3, 3)) - np.eye(3)) / 2
    for weights in (np.full(3, 1 / 3), *np.eye(3), *halves):
        # a face with both results is partly seen and needs no more tests
        undecided = np.flatnonzero(~(passed & failed))
        for start in range(0, len(undecided), BLOCK):
            index = undecided[start : start + BLOCK]
            test(index, np.broadcast_to(weights, (len(index), 3)))
    undecided = np.flatnonzero(~(passed & failed))
    for samples in rasterise(affine_charts(points_cam[undecided], camera).texels):
        test(undecided[samples.triangle], samples.barycentric)
    seen = np.zeros(len(mesh.faces), dtype=np.uint8)
    seen[faces] = passed.astype(np.uint8) + ~failed
    return seen


def bake_atlas(
    mesh: TriangleMesh,
    views: Sequence[SourceView],
    seen_faces: Sequence[np.ndarray],
    *,
    unseen: np.ndarray | None = None,
    max_size: int = MAX_SIZE,
    step: Callable[[], None] = lambda: None,
) -> TextureAtlas:
    """Lay out the faces that the frames saw, and bake the frames into their texels.

    Parameters
    ----------
    views
        The frames. A point gets the colour of the first one that saw it.
    seen_faces
        ``(F,)`` uint8 of each view, from :func:`classify_faces`.
    unseen
        ``(V, 3)`` colours of the vertices for what the frames did not see; ``None``: :data:`NEUTRAL`.
    step
        Called often; what it raises ends the work.
    """
    if len(views) == 1:
        return _baked(mesh, views, seen_faces[0], unseen, max_size, step)
    seen = np.stack(seen_faces)
    first = (seen > 0).argmax(axis=0)
    atlases = []
    for number in range(len(views)):
        levels = np.where(first == number, seen[number], _ELSEWHERE)
        atlases.append(_baked(mesh, views[number:], levels, unseen, max_size, step))
    sizes = np.array([atlas.observed.shape[::-1] for atlas in atlases])
    origins, (width, height) = pack_rectangles(sizes, np.zeros(2, np.int64), max_size)
    image, flags = np.full((height, width, 3), NEUTRAL, np.float32), np.zeros((height, width), dtype=bool)
    uv = np.empty((len(mesh.faces), 3, 2))
    for number, (atlas, size, (x, y)) in enumerate(zip(atlases, sizes, origins, strict=True)):
        part, own = (slice(y, y + size[1]), slice(x, x + size[0])), first == number
        image[part], flags[part] = atlas.image, atlas.observed
        uv[own] = (atlas.uv[own] * size + [x, height - y - size[1]]) / [width, height]
    separate = sum(atlas.separate_charts for atlas in atlases)
    return TextureAtlas(uv, image, flags, _counts(seen.max(axis=0)), separate)


def _counts(seen_faces: np.ndarray) -> tuple[int, int, int]:
    nothing, partly, fully = (int((seen_faces == level).sum()) for level in range(3))
    return nothing, partly, fully


def _baked(
    mesh: TriangleMesh,
    views: Sequence[SourceView],
    seen_faces: np.ndarray,
    unseen: np.ndarray | None,
    max_size: int,
    step: Callable[[], None],
) -> TextureAtlas:
    """The atlas of the faces that are not elsewhere, in the charts of the first view; the others fill its gaps."""
    camera, cam_from_model = views[0].camera, views[0].cam_from_model
    seen = np.flatnonzero((seen_faces > 0) & (seen_faces < _ELSEWHERE))
    corners, normals = mesh.vertices[mesh.faces[seen]], mesh.face_normals[seen]
    points_cam = transform_points(cam_from_model, mesh.vertices)[mesh.faces[seen]]
    charts = affine_charts(points_cam, camera)
    layer = frame_layer(charts, points_cam[..., 2], seen_faces[seen] == 2, camera)
    separate = np.flatnonzero(~layer.members)
    low = np.ceil(charts.texels[separate].min(axis=1) - GUTTER).astype(np.int64)
    sizes = np.floor(charts.texels[separate].max(axis=1) + GUTTER).astype(np.int64) - low + 1
    others = np.flatnonzero(seen_faces == 0)
    across = int(np.ceil(np.sqrt(len(others))))
    # with colours of their own, faces that the frame did not see have two by two texels each
    patch = np.full((1, 2), NEUTRAL_PATCH if unseen is None else max(2 * across, NEUTRAL_PATCH))
    origins, (width, height) = pack_rectangles(np.concatenate([sizes, patch]), layer.size, max_size)
    texels = charts.texels.copy()
    texels[layer.members] -= layer.low
    texels[separate] += (origins[:-1] - low)[:, None]

    def owned_texels() -> Iterator[Samples]:
        for start in range(0, len(layer.face), BLOCK):
            part = slice(start, start + BLOCK)
            face, x, y = layer.face[part], layer.x[part] - layer.low[0], layer.y[part] - layer.low[1]
            yield Samples(face, x, y, barycentric(texels[face], np.stack([x, y], axis=1)))
        for samples in rasterise(texels[separate], margin=GUTTER):
            yield samples._replace(triangle=separate[samples.triangle])

    footprints = points_cam[..., 2] / min(camera.fx, camera.fy)
    baked = np.full((height, width, 3), NEUTRAL, dtype=np.float32)
    flags = np.zeros((height, width), dtype=bool)
    for samples in owned_texels():
        face, x, y, _ = samples
        if unseen is not None:
            weights = np.clip(samples.barycentric, 0, None)
            weights /= weights.sum(axis=1, keepdims=True)
            baked[y, x] = np.einsum("nk,nkc->nc", weights, unseen[mesh.faces[seen[face]]])
        for view in views:
            step()
            points, fallback, retry = _surface_points(samples, texels, corners, footprints)
            good = view.observed(points, normals[face])
            # where the extended plane leaves the true surface, test the nearest point of the face instead
            retry = retry[~good[retry]]
            points[retry] = fallback[retry]
            step()
            good[retry] = view.observed(points[retry], normals[face[retry]])
            good &= ~flags[y, x]
            pixels, _ = view.project(points[good])
            inside = among_centres(pixels, view.camera.size_wh)
            good[good] = inside
            flags[y[good], x[good]] = True
            baked[y[good], x[good]] = view.colours(pixels[inside])
    uv = np.empty((len(mesh.faces), 3, 2))
    uv[:] = origins[-1] + np.array([[1.0, 2.0], [2.0, 2.0], [1.0, 1.0]])
    if unseen is not None and len(others):
        index = np.arange(len(others))
        place = origins[-1] + 2 * np.stack([index % across, index // across], axis=1)
        a, b, c = np.moveaxis(unseen[mesh.faces[others]], 1, 0)
        # linear inside the triangle of the first three
        for offset, colour in (((0, 0), a), ((1, 0), b), ((0, 1), c), ((1, 1), b + c - a)):
            x, y = (place + offset).T
            baked[y, x] = colour
        uv[others] = place[:, None] + np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])
    uv[seen] = texels
    uv = (uv + 0.5) / [width, height]
    uv[..., 1] = 1 - uv[..., 1]
    return TextureAtlas(uv, baked, flags, _counts(seen_faces), len(separate))


def _surface_points(
    samples: Samples, texels: np.ndarray, corners: np.ndarray, footprints: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Surface points of N texels, on the plane of their face, also beyond its edges.

    Parameters
    ----------
    samples
        The texels, with indices into the S faces.
    texels, corners
        ``(S, 3, 2)`` faces in the atlas, and ``(S, 3, 3)`` in the model frame, mm.
    footprints
        ``(S, 3)`` size of a frame pixel at the corners, mm.

    Returns
    -------
    ``(N, 3)`` points, ``(N, 3)`` nearest points in the face (valid for gutter texels only), and the indices of the
    gutter texels.
    """
    points = np.einsum("nk,nkd->nd", samples.barycentric, corners[samples.triangle])
    nearest = np.zeros_like(points)
    gutter = np.flatnonzero(samples.least < -1e-9)
    face = samples.triangle[gutter]
    inner, distance = nearest_barycentric(texels[face], np.stack([samples.x[gutter], samples.y[gutter]], axis=1))
    nearest[gutter] = np.einsum("nk,nkd->nd", inner, corners[face])
    step = points[gutter] - nearest[gutter]
    length = np.linalg.norm(step, axis=1)
    longest = MAX_SLOPE * distance * np.maximum((inner * footprints[face]).sum(axis=1), 0)
    shrink = np.divide(longest, length, out=np.ones_like(length), where=length > longest)
    points[gutter] = nearest[gutter] + step * shrink[:, None]
    return points, nearest, gutter
