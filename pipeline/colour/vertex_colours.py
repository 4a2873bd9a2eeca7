"""Vertex colours: the frames sampled bilinearly at the projected vertices (Zhang & Noble, eq. 1).

Triangles that the frame saw in part have vertices without a colour from it. These get the mean of their neighbours', so
that the part is not mixed with grey. Whether the frame saw a point of a triangle does not follow from its vertices: a
:class:`.SeenFrame` tells, as in the other modes.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..surface.mesh import TriangleMesh
from .seen_frame import SeenFrame

NEUTRAL = 0.5
"""Code value, 0..1, of surface that the frame did not see, in all three channels."""

OBSERVED_LEAST = 0.9999
"""If an interpolated flag is at least this large, all values that it was interpolated from are observed."""


@dataclass(frozen=True)
class VertexColours:
    """Colours of a mesh's vertices.

    Attributes
    ----------
    rgb
        ``(V, 3)`` float32, code values 0..1; :data:`NEUTRAL` where not covered.
    observed
        ``(V,)`` bool: the frame saw the vertex.
    covered
        ``(V,)`` bool: the vertex has a colour from the frame, its own or, on triangles seen in part, one continued.
    source
        The view that tells which points of the triangles were seen, where all three vertices are covered. ``None``:
        points are if all three vertices are observed.
    """

    rgb: np.ndarray
    observed: np.ndarray
    covered: np.ndarray
    source: SeenFrame | None = None

    @property
    def least(self) -> np.ndarray:
        """``(V,)`` bool: what all three vertices of an observed point's triangle are."""
        return self.observed if self.source is None else self.covered


def colour_vertices(mesh: TriangleMesh, views: Sequence[SeenFrame]) -> VertexColours:
    """Sample the frames at every vertex that they saw, each from the first one that did.

    A vertex counts as facing the frame if any of its faces does, so that the rim of the visible surface is kept. Those
    beside a depth step get the colour of the pixels that show their surface. The others of a triangle with a colour get
    the mean of their neighbours.
    """
    rgb, observed, covered = _sampled(mesh, views[0])
    for view in views[1:]:
        own_rgb, seen, found = _sampled(mesh, view)
        # a colour from beside a depth step gives way to one from a frame that saw the vertex
        better = (seen & ~observed) | (found & ~covered)
        rgb[better] = own_rgb[better]
        observed |= seen
        covered |= found
    _continue_to_neighbours(rgb, covered, mesh.faces)
    return VertexColours(rgb, observed, covered)


def _sampled(mesh: TriangleMesh, source: SeenFrame) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """``(V, 3)`` colours of the vertices from one frame, ``(V,)`` whether it saw them, and whether they have one."""
    facing = source.facing_faces(mesh)
    vertex_facing = np.zeros(len(mesh.vertices), dtype=bool)
    vertex_facing[mesh.faces[facing]] = True
    observed = vertex_facing & source.unoccluded(mesh.vertices)
    rgb = np.full((len(mesh.vertices), 3), NEUTRAL, dtype=np.float32)
    pixels, _ = source.project(mesh.vertices[observed])
    rgb[observed] = source.colours(pixels)
    beside = np.flatnonzero(vertex_facing & ~observed)
    colours, found = source.own_colours(mesh.vertices[beside], mesh.vertex_normals[beside])
    rgb[beside[found]] = colours[found]
    covered = observed.copy()
    covered[beside[found]] = True
    return rgb, observed, covered


def _continue_to_neighbours(rgb: np.ndarray, covered: np.ndarray, faces: np.ndarray) -> None:
    """Cover the vertices that share a face with a covered one, by the mean of these; in place."""
    has = covered[faces]
    partly = has.any(axis=1) & ~has.all(axis=1)
    faces, has = faces[partly], has[partly]
    without, neighbours = [], []
    for side in (1, 2):
        pairs = ~has & np.roll(has, side, axis=1)
        without.append(faces[pairs])
        neighbours.append(np.roll(faces, side, axis=1)[pairs])
    vertices, place = np.unique(np.concatenate(without), return_inverse=True)
    colours = rgb[np.concatenate(neighbours)]
    count = np.bincount(place, minlength=len(vertices))
    for channel in range(3):
        rgb[vertices, channel] = np.bincount(place, colours[:, channel], len(vertices)) / count
    covered[vertices] = True
