"""Error quadrics: the sum of squared distances of a point from many planes, as eleven numbers.

Source: Garland & Heckbert, "Surface simplification using quadric error metrics" (1997), weighted by area.
"""

import numpy as np

QUADRIC_SIZE = 11
"""Six of the symmetric matrix by rows, three of the linear part, the constant, and the sum of the weights."""

_BLOCK = 1 << 14
"""Edges at a time, whose numbers stay in the cache."""
_TOWARDS_MIDPOINT = 1e-4
"""Weight of a pull to the midpoint, relative to the matrix: it decides along a plane or a crease, and stays below noise
across it."""


def vertex_quadrics(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """``(11, V)`` quadrics of the planes of the faces at each vertex.

    Parameters
    ----------
    vertices, faces
        ``(3, V)``, mm, best around their centre, and ``(3, F)``.
    """
    a, b, c = (vertices[:, corner] for corner in faces)
    normal = cross(b - a, c - a)
    length = np.sqrt(dot(normal, normal))
    normal /= np.maximum(length, 1e-300)
    x, y, z = normal
    d = -dot(normal, a)
    corners, count = faces.ravel(), vertices.shape[1]
    entries = (x * x, x * y, x * z, y * y, y * z, z * z, x * d, y * d, z * d, d * d, np.ones_like(d))
    return np.stack([np.bincount(corners, np.tile(entry * length / 2, 3), count) for entry in entries])


def best_positions(
    vertices: np.ndarray, quadrics: np.ndarray, first: np.ndarray, second: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Where the vertices that edges collapse to lie best.

    Parameters
    ----------
    vertices, quadrics
        ``(3, V)`` mm and ``(11, V)``.
    first, second
        ``(E,)`` ends of the edges.

    Returns
    -------
    Positions ``(3, E)``, mm; their mean squared distances ``(E,)``, mm^2, from the planes; the cost ``(E,)`` of the
    collapse: the sum of the squared distances, and the shorter edge first where there are none.
    """
    count = len(first)
    position, mean_squared, cost = np.empty((3, count)), np.empty(count), np.empty(count)
    for at in range(0, count, _BLOCK):
        block = slice(at, at + _BLOCK)
        i, j = first[block], second[block]
        quadric = np.take(quadrics, i, axis=1)
        quadric += np.take(quadrics, j, axis=1)
        start, end = np.take(vertices, i, axis=1), np.take(vertices, j, axis=1)
        side = end - start
        squared_length = dot(side, side)
        middle = (start + end) / 2
        best = middle + _step(quadric, middle, squared_length)
        squared = _errors(quadric, best)
        # an end that lies on all planes, as beside a crease, is exact: the pull to the midpoint keeps the best off it
        for corner in (start, end):
            of_corner = _errors(quadric, corner)
            better = of_corner < squared / 4
            best[:, better], squared[better] = corner[:, better], of_corner[better]
        weight = np.maximum(quadric[10], 1e-300)
        position[:, block], mean_squared[block] = best, squared / weight
        cost[block] = squared + 1e-5 * weight * squared_length
    return position, mean_squared, cost


def _step(quadric: np.ndarray, middle: np.ndarray, squared_length: np.ndarray) -> np.ndarray:
    """``(3, E)`` from the midpoint to the minimum of the quadric, at most an edge long."""
    a, b, c, d, e, f, x, y, z = quadric[:9]
    mx, my, mz = middle
    gx, gy, gz = a * mx + b * my + c * mz + x, b * mx + d * my + e * mz + y, c * mx + e * my + f * mz + z
    pull = _TOWARDS_MIDPOINT * (a + d + f) + 1e-300
    a, d, f = a + pull, d + pull, f + pull
    c00, c01, c02 = d * f - e * e, c * e - b * f, b * e - c * d
    c11, c12, c22 = a * f - c * c, b * c - a * e, a * d - b * b
    inverse = -1 / np.maximum(a * c00 + b * c01 + c * c02, 1e-300)
    step = np.stack([c00 * gx + c01 * gy + c02 * gz, c01 * gx + c11 * gy + c12 * gz, c02 * gx + c12 * gy + c22 * gz])
    step *= inverse
    step *= np.minimum(1, np.sqrt(squared_length / np.maximum(dot(step, step), 1e-300)))
    return step


def _errors(quadric: np.ndarray, point: np.ndarray) -> np.ndarray:
    """``(E,)`` sums of weighted squared distances of points ``(3, E)``, mm^4."""
    a, b, c, d, e, f, p, q, r, constant = quadric[:10]
    x, y, z = point
    squared = x * (a * x + 2 * (b * y + c * z + p)) + y * (d * y + 2 * (e * z + q)) + z * (f * z + 2 * r) + constant
    return np.maximum(squared, 0)


def dot(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """``(N,)`` products of vectors ``(3, N)``; sums in one order on every numpy."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """``(3, N)`` cross products of vectors ``(3, N)``."""
    return np.stack([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])
