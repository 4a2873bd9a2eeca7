"""How far points lie from a surface: exact distances from a mesh.

Source of the distance from a triangle: Ericson, "Real-Time Collision Detection" (2005), section 5.1.5, with the cases
as one branchless expression.
"""

import numpy as np

from .mesh import TriangleMesh

_BLOCK = 64
"""Faces in a row that share a box: files have neighbours together."""

_ROUNDED = 1 + 1e-12
"""Leaves room for rounding where a box that decides must not be left out."""


def deviation(points: np.ndarray, mesh: TriangleMesh) -> np.ndarray:
    """``(N,)`` distances of a few points ``(N, 3)`` from the nearest point of the mesh, both in one frame, mm."""
    corners = [mesh.vertices[corner] for corner in mesh.faces.T]
    starts = np.arange(0, len(mesh.faces), _BLOCK)
    lower = np.minimum.reduceat(np.min(corners, axis=0), starts)
    upper = np.maximum.reduceat(np.max(corners, axis=0), starts)
    found = np.empty(len(points))
    for number, point in enumerate(np.asarray(points, np.float64)):
        farthest = (np.maximum(np.abs(point - lower), np.abs(point - upper)) ** 2).sum(axis=1)
        nearest = (np.maximum(np.maximum(lower - point, point - upper), 0) ** 2).sum(axis=1)
        boxes = starts[nearest <= farthest.min() * _ROUNDED]
        face = (boxes[:, None] + np.arange(_BLOCK)).ravel()
        face = face[face < len(mesh.faces)]
        a, b, c = (corner[face].T for corner in corners)
        found[number] = squared_triangle_distances(b - a, c - a, point[:, None] - a).min()
    return np.sqrt(found)


def squared_triangle_distances(first_side: np.ndarray, second_side: np.ndarray, offset: np.ndarray) -> np.ndarray:
    """``(N,)`` squared distances of N points from N triangles, one each.

    Parameters
    ----------
    first_side, second_side
        ``(3, N)`` from the triangle's first corner to its second and third. Needles and points are allowed.
    offset
        ``(3, N)`` from the triangle's first corner to the point.
    """
    aa, cc, ac = _dot(first_side, first_side), _dot(second_side, second_side), _dot(first_side, second_side)
    pa, pc, pp = _dot(first_side, offset), _dot(second_side, offset), _dot(offset, offset)
    # barycentric coordinates of the foot in the plane, times the determinant
    determinant = aa * cc - ac * ac
    s, t = cc * pa - ac * pc, aa * pc - ac * pa
    with np.errstate(divide="ignore", invalid="ignore"):
        inside = (s >= 0) & (t >= 0) & (s + t <= determinant) & (determinant > 1e-12 * aa * cc)
        from_plane = pp - (s * pa + t * pc) / determinant
        third = aa + cc - 2 * ac
        along_third = pc - pa - ac + aa
        nearest = np.fmin(_from_side(aa, pa, pp), _from_side(cc, pc, pp))
        # fmin: a side without length gives NaN, its ends are those of the others
        nearest = np.fmin(nearest, _from_side(third, along_third, pp - 2 * pa + aa))
    return np.maximum(np.where(inside, from_plane, np.fmin(nearest, pp)), 0)


def _dot(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def _from_side(length: np.ndarray, along: np.ndarray, squared: np.ndarray) -> np.ndarray:
    """Squared distances from segments of squared ``length``, ``along`` = side . offset, ``squared`` from its start."""
    part = np.clip(along / length, 0, 1)
    return squared - part * (2 * along - part * length)
