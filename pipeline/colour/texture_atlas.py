"""A texture for other programs: the frames' own pixels, and a UV map that is the projection into them.

A face that a frame saw all of has that frame's pixels, of the first such frame. Faces that no frame saw whole share a
neutral patch, or have two by two texels each with the colours of their corners: so nothing is shown on surface that no
frame saw, and what is seen ends at whole faces, as colours of vertices do. A UV map is affine in each face: on large
ones, perspective bends the texture.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from ..errors import InputError
from ..surface.mesh import TriangleMesh
from ..transforms import BLOCK
from .seen_frame import SeenFrame
from .vertex_colours import NEUTRAL

MAX_SIZE = 16384
"""Largest width and height of an atlas, texels: the limit of common graphics cards."""

NEUTRAL_PATCH = 4
"""Side of the patch for faces that no frame saw whole, texels."""

MOST_STEPS = 256
"""Most steps along an edge at which a face is tested: one for each pixel of it, up to so many."""

BENT_PX = 0.5
"""How far perspective may bend the texture before the user is told, frame pixels."""


@dataclass(frozen=True)
class TextureAtlas:
    """A texture made of the frames, and its UV map.

    Attributes
    ----------
    uv
        ``(F, 3, 2)`` float64 per face corner, in [0, 1], origin bottom-left with v up (Blender, OBJ): the centre of
        the texel in column i and row j (from the top) is ((i + 0.5) / width, 1 - (j + 0.5) / height).
    image
        ``(h, w, 3)`` float32, top row first; where not observed, a given colour, or
        :data:`oneframe.colour.vertex_colours.NEUTRAL`.
    observed
        ``(h, w)`` bool: the texel shows surface in a frame.
    seen
        ``(F,)`` bool: the faces that have a frame's pixels.
    bent_px
        How far off its middle an edge has the texture of its middle, at most, frame pixels.
    """

    uv: np.ndarray
    image: np.ndarray
    observed: np.ndarray
    seen: np.ndarray
    bent_px: float

    def messages(self) -> list[str]:
        """For the user: size and coverage, and what perspective does to large faces."""
        height, width = self.observed.shape
        said = [f"texture: {width}x{height} texels; {self.seen.sum()} of {len(self.seen)} faces were seen whole"]
        if self.bent_px > BENT_PX:
            said.append(
                f"the largest faces have the texture up to {self.bent_px:.1f} px off, as it is not bent by perspective "
                "in a face; use a finer surface"
            )
        return said


def seen_faces(
    mesh: TriangleMesh, faces: np.ndarray, view: SeenFrame, step: Callable[[], None] = lambda: None
) -> np.ndarray:
    """``(N,)`` bool: whether a frame saw all of faces ``(N,)``, by points as dense as its pixels.

    ``step`` is called often; what it raises ends the work.
    """
    pixels = view.project(mesh.vertices)[0][mesh.faces[faces]]
    # NaN behind the camera: seen from nowhere
    longest = np.linalg.norm(np.roll(pixels, -1, axis=1) - pixels, axis=2).max(axis=1)
    tested = view.facing_faces(mesh)[faces] & np.isfinite(longest)
    steps = 2 ** np.ceil(np.log2(np.clip(np.where(tested, longest, 2), 2, MOST_STEPS))).astype(int)
    seen = np.zeros(len(faces), dtype=bool)
    for count in np.unique(steps[tested]):
        first, second = np.nonzero(np.tri(count + 1)[::-1])
        weights = np.stack([count - first - second, first, second], axis=1) / count
        group, size = np.flatnonzero(tested & (steps == count)), max(1, BLOCK // len(weights))
        for start in range(0, len(group), size):
            step()
            part = group[start : start + size]
            points = np.einsum("pk,nkd->npd", weights, mesh.vertices[mesh.faces[faces[part]]]).reshape(-1, 3)
            normals = np.repeat(mesh.face_normals[faces[part]], len(weights), axis=0)
            seen[part] = view.observed(points, normals).reshape(len(part), -1).all(axis=1)
    return seen


def bake_atlas(
    mesh: TriangleMesh,
    views: Sequence[SeenFrame],
    *,
    unseen: np.ndarray | None = None,
    max_size: int = MAX_SIZE,
    step: Callable[[], None] = lambda: None,
) -> TextureAtlas:
    """Put the frames' pixels of the surface below one another, and map the faces to them.

    Parameters
    ----------
    views
        The frames. A face gets the pixels of the first one that saw it whole.
    unseen
        ``(V, 3)`` colours of the vertices for the other faces; ``None``: :data:`NEUTRAL`.
    max_size
        Texels that the texture may be wide or high; a larger one is refused.
    step
        As of :func:`seen_faces`.
    """
    frame, bent_px = np.full(len(mesh.faces), -1), 0.0
    texels, parts, top = np.empty((len(mesh.faces), 3, 2)), list[tuple[np.ndarray, np.ndarray]](), 0
    for number, view in enumerate(views):
        left = np.flatnonzero(frame < 0)
        own = left[seen_faces(mesh, left, view, step)]
        if len(own) == 0:
            continue
        frame[own] = number
        pixels, depth = (values[mesh.faces[own]] for values in view.project(mesh.vertices))
        bent_px = max(bent_px, _bend_px(pixels, depth))
        low = np.maximum(np.floor(pixels.min(axis=(0, 1))).astype(int), 0)
        high = np.minimum(np.ceil(pixels.max(axis=(0, 1))).astype(int) + 1, view.camera.size_wh)
        image, surface = (values[low[1] : high[1], low[0] : high[0]] for values in view.continued)
        texels[own] = pixels - low + [0, top]
        parts.append((np.where(surface[..., None] > 0, image, np.float32(NEUTRAL)), surface > 0))
        top += high[1] - low[1]
    others = np.flatnonzero(frame < 0)
    patch, texels[others] = _patch(None if unseen is None else unseen[mesh.faces[others]], len(others))
    texels[others] += [0, top]
    parts.append((patch, np.zeros(patch.shape[:2], bool)))
    width, height = max(image.shape[1] for image, _ in parts), top + len(patch)
    if max(width, height) > max_size:
        raise InputError(
            f"texture: expected at most {max_size}x{max_size} texels, found {width}x{height} for {len(views)} frames "
            f"and {len(others)} faces that none of them saw; use vertex colours, or frames of fewer pixels"
        )
    whole, flags = np.full((height, width, 3), NEUTRAL, np.float32), np.zeros((height, width), dtype=bool)
    row = 0
    for image, observed in parts:
        block = slice(row, row + image.shape[0]), slice(0, image.shape[1])
        whole[block], flags[block] = image, observed
        row += image.shape[0]
    uv = (texels + 0.5) / [width, height]
    uv[..., 1] = 1 - uv[..., 1]
    return TextureAtlas(uv, whole, flags, frame >= 0, bent_px)


def _bend_px(pixels: np.ndarray, depth: np.ndarray) -> float:
    """How far, at most, the middle of an edge projects from the middle of the edge's projection.

    For ends at depths a and b this is \\|b - a\\| / (2 (a + b)) of the edge's length in pixels.
    """
    other, edge = np.roll(depth, -1, axis=1), np.linalg.norm(np.roll(pixels, -1, axis=1) - pixels, axis=2)
    return float((edge * np.abs(other - depth) / (2 * (other + depth))).max())


def _patch(colours: np.ndarray | None, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Texels of ``count`` faces that no frame saw, and the places ``(count, 3, 2)`` of the faces' corners in them.

    ``colours`` ``(count, 3, 3)`` are those of the corners; ``None``: neutral.
    """
    if colours is None or count == 0:
        patch = np.full((NEUTRAL_PATCH, NEUTRAL_PATCH, 3), NEUTRAL, np.float32)
        return patch, np.broadcast_to(np.array([[1.0, 2.0], [2.0, 2.0], [1.0, 1.0]]), (count, 3, 2))
    across = int(np.ceil(np.sqrt(count)))
    patch = np.full((2 * -(-count // across), 2 * across, 3), NEUTRAL, np.float32)
    index = np.arange(count)
    place = 2 * np.stack([index % across, index // across], axis=1)
    a, b, c = np.moveaxis(colours, 1, 0)
    # linear inside the triangle of the first three
    for offset, colour in (((0, 0), a), ((1, 0), b), ((0, 1), c), ((1, 1), b + c - a)):
        x, y = (place + offset).T
        patch[y, x] = colour
    return patch, place[:, None] + np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])
