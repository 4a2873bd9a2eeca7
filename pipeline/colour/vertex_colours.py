"""Vertex colours: the frame sampled bilinearly at the projected vertices (Zhang & Noble, eq. 1)."""

from dataclasses import dataclass

import numpy as np

from ..images.pixel_values import sample_bilinear
from ..surface.mesh import TriangleMesh
from .source_view import SourceView

NEUTRAL = 0.5
"""Code value, 0..1, of surface that the frame did not see, in all three channels."""


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


def colour_vertices(mesh: TriangleMesh, source: "SourceView") -> VertexColours:
    """Sample the frame at every vertex that it saw.

    A vertex counts as facing the frame if any of its faces does, so that the rim of the visible surface is kept.
    """
    facing = source.facing_faces(mesh)
    vertex_facing = np.zeros(len(mesh.vertices), dtype=bool)
    vertex_facing[mesh.faces[facing]] = True
    observed = vertex_facing & source.unoccluded(mesh.vertices)
    rgb = np.full((len(mesh.vertices), 3), NEUTRAL, dtype=np.float32)
    pixels, _ = source.project(mesh.vertices[observed])
    rgb[observed] = sample_bilinear(source.image, pixels)
    return VertexColours(rgb, observed)
