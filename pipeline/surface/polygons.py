"""Split polygons into triangles: convex ones as fans, others so that no triangle leaves the polygon."""

import numpy as np

_BLOCK = 1 << 18
"""Polygons that are computed at a time, which bounds the memory that it takes."""

_STRAIGHT = 1e-9
"""A corner turns inwards if it does so by more than this part of the polygon's area: less is rounding."""


def triangulated(vertices: np.ndarray, lengths: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """Split polygons.

    Convex ones become fans around their first corner. A polygon with one corner that turns inwards is seen whole from
    that corner and becomes a fan around it; with more, ears are cut off (Meisters 1975).

    Parameters
    ----------
    vertices
        ``(V, 3)``, finite or not.
    lengths, corners
        ``(P,)`` corners of each polygon; ``(sum,)`` their vertices, which may be out of range: then all are fans.

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
        parts.append(corners[_triangle_places(vertices, shape_of, begin, count)])
    return np.concatenate(parts) if parts else np.empty((0, 3), corners.dtype)


def _triangle_places(vertices: np.ndarray, corners: np.ndarray, starts: np.ndarray, lengths: np.ndarray) -> np.ndarray:
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
    hub = np.zeros(len(lengths), np.int64)
    single = inward & (inwards == 1)[polygon]
    hub[polygon[single]] = within[single]
    per_polygon = lengths - 2
    owner = np.repeat(np.arange(len(lengths)), per_polygon)
    first_triangle = np.cumsum(per_polygon) - per_polygon
    step = np.arange(len(owner)) - first_triangle[owner]
    order = np.stack([np.zeros_like(step), step + 1, step + 2], axis=1) + hub[owner, None]
    places = starts[owner, None] + order % lengths[owner, None]
    # a quadrilateral with two crosses itself
    for index in np.flatnonzero((inwards > 1) & (lengths > 4)):
        cut = _ears(here[begins[index] : begins[index] + lengths[index]], normals[index])
        places[first_triangle[index] :][: len(cut)] = starts[index] + cut
    return places


def _ears(points: np.ndarray, normal: np.ndarray) -> np.ndarray:
    """``(N - 2, 3)`` triangles of a polygon ``(N, 3)`` whose area and side are those of ``normal``."""
    # flattened along the longest axis of the normal, counter-clockwise
    axis = int(np.argmax(np.abs(normal)))
    flat = points[:, [(axis + 1) % 3, (axis + 2) % 3]]
    flat = flat if normal[axis] > 0 else flat[:, ::-1]
    x, y = flat.T.tolist()
    left = list(range(len(points)))
    ears: list[tuple[int, int, int]] = []
    at, tried = 0, 0
    while len(left) > 3 and tried < len(left):
        a, b, c = corners = left[at - 1], left[at], left[(at + 1) % len(left)]
        turns_out = (x[b] - x[a]) * (y[c] - y[b]) > (y[b] - y[a]) * (x[c] - x[b])
        if turns_out and not _holds_a_point(flat[list(corners)], flat[left]):
            ears.append(corners)
            del left[at]
            # the next ear is often beside the last one
            at, tried = at - 1, 0
        else:
            at, tried = at + 1, tried + 1
        at %= len(left)
    # what crosses itself has no ears left
    ears += [(left[0], left[step], left[step + 1]) for step in range(1, len(left) - 1)]
    return np.array(ears)


def _holds_a_point(triangle: np.ndarray, points: np.ndarray) -> bool:
    """Whether another of the points than the corners lies in a triangle or on its sides."""
    edges = np.roll(triangle, -1, axis=0) - triangle
    to = points[:, None, :] - triangle
    sides = edges[:, 0] * to[..., 1] - edges[:, 1] * to[..., 0]
    is_corner = (to == 0).all(axis=2).any(axis=1)
    return bool(((sides >= 0).all(axis=1) & ~is_corner).any())
