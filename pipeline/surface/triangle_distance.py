"""Distance of points from triangles, exact and in bulk.

Source: Ericson, "Real-Time Collision Detection" (2005), section 5.1.5, with the cases as one branchless expression.
"""

import numpy as np


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


def nearest_weights(first_side: np.ndarray, second_side: np.ndarray, offset: np.ndarray) -> np.ndarray:
    """``(3, N)`` barycentric coordinates of the nearest points of N triangles to N points, one each.

    Parameters
    ----------
    first_side, second_side, offset
        As for :func:`squared_triangle_distances`.
    """
    aa, cc, ac = _dot(first_side, first_side), _dot(second_side, second_side), _dot(first_side, second_side)
    pa, pc = _dot(first_side, offset), _dot(second_side, offset)
    determinant = np.maximum(aa * cc - ac * ac, 1e-300)
    s, t = (cc * pa - ac * pc) / determinant, (aa * pc - ac * pa) / determinant
    inside = (s >= 0) & (t >= 0) & (s + t <= 1) & (determinant > 1e-12 * aa * cc)
    along_first = np.clip(pa / np.maximum(aa, 1e-300), 0, 1)
    along_second = np.clip(pc / np.maximum(cc, 1e-300), 0, 1)
    along_third = np.clip((pc - pa - ac + aa) / np.maximum(aa + cc - 2 * ac, 1e-300), 0, 1)
    none = np.zeros_like(s)
    best, least = np.stack([s, t]), np.where(inside, -1.0, np.inf)
    for candidate in ((along_first, none), (none, along_second), (1 - along_third, along_third)):
        apart = offset - candidate[0] * first_side - candidate[1] * second_side
        squared = _dot(apart, apart)
        nearer = squared < least
        best[:, nearer], least[nearer] = np.stack(candidate)[:, nearer], squared[nearer]
    return np.stack([1 - best[0] - best[1], best[0], best[1]])
