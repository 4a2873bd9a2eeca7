"""Split polygons into triangles: fans that do not leave the polygon."""

import numpy as np

from ..errors import InputError

_BLOCK = 1 << 18
"""Polygons that are computed at a time, which bounds the memory that it takes."""

_STRAIGHT = 1e-9
"""A corner turns inwards if it does so by more than this part of the polygon's area: less is rounding."""


def triangulated(vertices: np.ndarray, lengths: np.ndarray, corners: np.ndarray, where: str) -> np.ndarray:
    """Split polygons.

    Convex ones become fans around their first corner. A polygon with one corner that turns inwards is seen whole from
    that corner and becomes a fan around it; one with more is refused, but for quadrilaterals, which cross themselves.

    Parameters
    ----------
    vertices
        ``(V, 3)``, finite or not.
    lengths, corners
        ``(P,)`` corners of each polygon; ``(sum,)`` their vertices, which may be out of range: then all are fans.
    where
        Names the file in messages.

    Returns
    -------
    ``(F, 3)`` triangles, polygon by polygon, wound like the polygons; none for those of less than three corners.
    """
    if (lengths == 3).all():
        return corners.reshape(-1, 3)
    if len(corners) and (corners.min() < 0 or corners.max() >= len(vertices)):
        vertices = np.zeros((1, 3))
        shape_of = np.zeros_like(corners)
    else:
        shape_of = corners
    starts = np.cumsum(lengths) - lengths
    is_face = lengths >= 3
    starts, lengths = starts[is_face], lengths[is_face]
    parts = []
    for at in range(0, len(lengths), _BLOCK):
        count, begin = lengths[at : at + _BLOCK], starts[at : at + _BLOCK]
        parts.append(corners[_triangle_places(vertices, shape_of, begin, count, where)])
    return np.concatenate(parts) if parts else np.empty((0, 3), corners.dtype)


def _triangle_places(
    vertices: np.ndarray, corners: np.ndarray, starts: np.ndarray, lengths: np.ndarray, where: str
) -> np.ndarray:
    """``(F, 3)`` places in ``corners`` of the triangles of polygons that begin at ``starts``."""
    polygon = np.repeat(np.arange(len(lengths)), lengths)
    within = np.arange(len(polygon)) - (np.cumsum(lengths) - lengths)[polygon]
    first, length = starts[polygon], lengths[polygon]
    here, after, before = (vertices[corners[first + (within + step) % length]] for step in (0, 1, -1))
    origin = vertices[corners[first]]
    begins = np.cumsum(lengths) - lengths
    normals = np.add.reduceat(np.cross(here - origin, after - origin), begins)
    turns = (np.cross(here - before, after - here) * normals[polygon]).sum(axis=1)
    inward = turns < -_STRAIGHT * (normals**2).sum(axis=1)[polygon]
    inwards = np.add.reduceat(inward.astype(np.int64), begins)
    if ((inwards > 1) & (lengths > 4)).any():
        raise InputError(
            f"{where}: expected polygons with up to one corner that turns inwards, found others; triangulate the mesh, "
            "for example in Blender (Ctrl T)"
        )
    hub = np.zeros(len(lengths), np.int64)
    single = inward & (inwards == 1)[polygon]
    hub[polygon[single]] = within[single]
    per_polygon = lengths - 2
    owner = np.repeat(np.arange(len(lengths)), per_polygon)
    first_triangle = np.cumsum(per_polygon) - per_polygon
    step = np.arange(len(owner)) - first_triangle[owner]
    order = np.stack([np.zeros_like(step), step + 1, step + 2], axis=1) + hub[owner, None]
    places = starts[owner, None] + order % lengths[owner, None]
    return places
