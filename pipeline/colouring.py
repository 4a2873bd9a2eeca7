"""Frame -> surface colours: bilinear sampling at projected points, per vertex (Zhang & Noble, eq. 1)."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from .mesh import TriangleMesh

if TYPE_CHECKING:
    from .visibility import SourceView

NEUTRAL = 0.5
"""Code value (0..1) given to surface that the frame did not see, in all three channels."""


@dataclass(frozen=True)
class VertexColours:
    """Colours of a mesh's vertices.

    Attributes
    ----------
    rgb
        ``(V, 3)`` float32, code values 0..1; :data:`NEUTRAL` where not observed.
    observed
        ``(V,)`` bool.
    """

    rgb: np.ndarray
    observed: np.ndarray


def sample_bilinear(image: np.ndarray, pixels: np.ndarray) -> np.ndarray:
    """Sample ``(H, W)`` or ``(H, W, C)`` at ``(N, 2)`` pixels; 0 outside, also in the outer half pixel.

    Outside means that a pixel of non-zero weight does not exist, or NaN coordinates.
    """
    height, width = image.shape[:2]
    # coordinates computed from a pixel's own ray may miss its centre by rounding; that is not "outside"
    inside = ((pixels >= -1e-3) & (pixels <= np.array([width - 1, height - 1]) + 1e-3)).all(axis=1)
    u = np.clip(np.where(inside, pixels[:, 0], 0), 0, width - 1)
    v = np.clip(np.where(inside, pixels[:, 1], 0), 0, height - 1)
    left, top = np.minimum(u.astype(np.int64), max(width - 2, 0)), np.minimum(v.astype(np.int64), max(height - 2, 0))
    right, bottom = np.minimum(left + 1, width - 1), np.minimum(top + 1, height - 1)
    across, down = u - left, v - top
    if image.ndim == 3:
        across, down, inside = across[:, None], down[:, None], inside[:, None]
    upper = image[top, left] * (1 - across) + image[top, right] * across
    lower = image[bottom, left] * (1 - across) + image[bottom, right] * across
    return np.where(inside, upper * (1 - down) + lower * down, 0)


def colour_vertices(mesh: TriangleMesh, source: "SourceView") -> VertexColours:
    """Sample the frame at every vertex that it saw.

    A vertex counts as facing the frame if any face around it does, so that the rim of the visible surface is kept.
    """
    facing = source.facing_faces(mesh)
    vertex_facing = np.zeros(len(mesh.vertices), dtype=bool)
    vertex_facing[mesh.faces[facing]] = True
    observed = vertex_facing & source.unoccluded(mesh.vertices)
    rgb = np.full((len(mesh.vertices), 3), NEUTRAL, dtype=np.float32)
    pixels, _ = source.project(mesh.vertices[observed])
    rgb[observed] = sample_bilinear(source.image, pixels)
    return VertexColours(rgb, observed)
