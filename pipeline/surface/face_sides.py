"""How the faces of a mesh hang together: edges, neighbours, borders, creases."""

from dataclasses import dataclass

import numpy as np

from .quadrics import dot

SHARPEST_COSINE = 0.5
"""Cosine between the normals of neighbouring faces, where the original has no crease."""
_SHARPER = 0.1
"""How much smaller it may be than in a crease of the original."""


@dataclass(frozen=True)
class Sides:
    """The sides of faces ``(3, F)``.

    Attributes
    ----------
    edges
        ``(2, E)`` vertices.
    neighbours
        ``(3, F)`` the face beyond the side from each corner to the next; -1 if there is not just one, or if its front
        is on the other side.
    border
        ``(V,)`` bool: vertices of such sides.
    """

    edges: np.ndarray
    neighbours: np.ndarray
    border: np.ndarray


def face_sides(faces: np.ndarray, vertex_count: int) -> Sides:
    """Edges, neighbours and border of faces ``(3, F)``."""
    face_count = faces.shape[1]
    start, end = faces.ravel(), faces[[1, 2, 0]].ravel()
    # the lowest bit is the direction: an inner edge has both, once
    key = (np.minimum(start, end) * vertex_count + np.maximum(start, end)) * 2 + (start > end)
    order = np.argsort(key)
    key = key[order]
    edge = key >> 1
    first = np.flatnonzero(np.append(True, edge[1:] != edge[:-1]))
    size = np.diff(np.append(first, len(edge)))
    inner = size == 2
    inner[inner] = key[first[inner]] != key[first[inner] + 1]
    edges = np.stack([edge[first] // vertex_count, edge[first] % vertex_count])
    neighbours = np.full(3 * face_count, -1)
    one, other = order[first[inner]], order[first[inner] + 1]
    neighbours[one], neighbours[other] = other % face_count, one % face_count
    border = np.zeros(vertex_count, bool)
    border[edges[:, ~inner]] = True
    return Sides(edges, neighbours.reshape(3, -1), border)


def creases(faces: np.ndarray, normals: np.ndarray, sides: Sides) -> np.ndarray:
    """``(V,)`` cosine of the sharpest crease at each vertex; 1 where there is none.

    Parameters
    ----------
    faces, normals
        ``(3, F)`` vertices and unit normals of the faces that ``sides`` belong to.
    """
    sharpest = np.ones(len(sides.border))
    for side, beyond in enumerate(sides.neighbours):
        cosine = np.where(beyond < 0, 1, dot(normals, np.take(normals, beyond, axis=1)))
        np.minimum.at(sharpest, faces[side], cosine)
        np.minimum.at(sharpest, faces[(side + 1) % 3], cosine)
    return sharpest


def smallest_cosine(crease: np.ndarray) -> np.ndarray:
    """The smallest cosine that is allowed between neighbouring faces, where the original has one of ``crease``."""
    return np.minimum(SHARPEST_COSINE, crease - _SHARPER)


def folded(faces: np.ndarray, normals: np.ndarray, sides: Sides, crease: np.ndarray) -> np.ndarray:
    """``(F,)`` bool: the angle to a neighbour is sharper than allowed.

    Parameters
    ----------
    faces, normals, crease
        ``(3, F)`` vertices and unit normals, and ``(V,)`` cosine of the sharpest crease of the original.
    """
    found = np.zeros(faces.shape[1], bool)
    for side, beyond in enumerate(sides.neighbours):
        limit = smallest_cosine(np.minimum(crease[faces[side]], crease[faces[(side + 1) % 3]]))
        found |= (beyond >= 0) & (dot(normals, np.take(normals, beyond, axis=1)) < limit)
    return found
