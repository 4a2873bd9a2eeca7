"""The nearest face at points of an image, and its inverse depth: which surface a pinhole camera sees.

A corner X (camera axes) has the homogeneous pixel p = K X, whose last number is its depth z. At an image point
r = (u, v, 1) each corner of a face has a weight, the determinant of r and the other two corners,

    e0 = (p1 x p2) . r,  e1 = (p2 x p0) . r,  e2 = (p0 x p1) . r,

and e0 p0 + e1 p1 + e2 p2 = d r for some d. So r meets the face if no two weights have opposite signs, at the inverse
depth (e0 + e1 + e2) / d with d = e0 z0 + e1 z1 + e2 z2: a mean of the corners', affine in the image. Nothing is
clipped: a face may reach behind the camera (Olano & Greer, "Triangle scan conversion using 2D homogeneous coordinates",
1997).
A point on an edge, or on a corner, belongs to all faces there: rounding leaves no gap between neighbours.
"""

import numpy as np

from .compiled import compiled

OUTSIDE = 1e-9
"""How far outside a face, in weights of sum 1, a point may be."""


@compiled
def projected(vertices: np.ndarray, px_from_model: np.ndarray) -> np.ndarray:
    """``(V, 3)`` vertices by a ``(3, 4)`` matrix -> ``(V, 5)`` homogeneous pixels x, y, z, and column and row.

    The latter are NaN at and behind the plane of the camera's centre.
    """
    points = np.empty((len(vertices), 5))
    for number in range(len(vertices)):
        point = points[number]
        for row in range(3):
            point[row] = px_from_model[row, 3]
            for axis in range(3):
                point[row] += px_from_model[row, axis] * vertices[number, axis]
        in_front = point[2] > 0
        point[3] = point[0] / point[2] if in_front else np.nan
        point[4] = point[1] / point[2] if in_front else np.nan
    return points


@compiled
def _point(points: np.ndarray, vertex: int) -> tuple[float, ...]:
    """One of :func:`projected` points, in numbers: twice as quick as a view of the array."""
    return points[vertex, 0], points[vertex, 1], points[vertex, 2], points[vertex, 3], points[vertex, 4]


@compiled
def _edges(p0: tuple[float, ...], p1: tuple[float, ...], p2: tuple[float, ...]) -> tuple[float, ...]:
    """The three cross products of a face's corners, whose products with a pixel are the weights."""
    x0, y0, z0, x1, y1, z1, x2, y2, z2 = p0[0], p0[1], p0[2], p1[0], p1[1], p1[2], p2[0], p2[1], p2[2]
    return (
        y1 * z2 - z1 * y2, z1 * x2 - x1 * z2, x1 * y2 - y1 * x2,
        y2 * z0 - z2 * y0, z2 * x0 - x2 * z0, x2 * y0 - y2 * x0,
        y0 * z1 - z0 * y1, z0 * x1 - x0 * z1, x0 * y1 - y0 * x1,
    )  # fmt: skip


@compiled
def _weights(edges: tuple[float, ...], u: float, v: float) -> tuple[float, float, float]:
    """The weights of the corners at an image point."""
    a0, b0, c0, a1, b1, c1, a2, b2, c2 = edges
    return a0 * u + b0 * v + c0, a1 * u + b1 * v + c1, a2 * u + b2 * v + c2


@compiled
def _inverse_depth(e0: float, e1: float, e2: float, z0: float, z1: float, z2: float) -> float:
    """Of a face at weights of its corners; 0 where it is not met."""
    total = e0 + e1 + e2
    least = -OUTSIDE * total
    if not ((e0 >= least and e1 >= least and e2 >= least) or (e0 <= least and e1 <= least and e2 <= least)):
        return 0.0
    d = e0 * z0 + e1 * z1 + e2 * z2
    return total / d if d != 0 else 0.0


@compiled
def _reach(
    p0: tuple[float, ...], p1: tuple[float, ...], p2: tuple[float, ...], axis: int, size: int
) -> tuple[float, float]:
    """Least and largest column (axis 0) or row of the part of a face in front, as far as the image goes."""
    if p0[2] > 0 and p1[2] > 0 and p2[2] > 0:
        low = min(p0[3 + axis], p1[3 + axis], p2[3 + axis])
        high = max(p0[3 + axis], p1[3 + axis], p2[3 + axis])
    else:
        low, high = np.inf, -np.inf
        for p, q in ((p0, p1), (p1, p2), (p2, p0)):
            if p[2] > 0:
                low, high = min(low, p[3 + axis]), max(high, p[3 + axis])
            if (p[2] > 0) != (q[2] > 0):
                # the edge goes off to infinity on the side where it crosses the plane of the camera's centre
                crossing = p[axis] * abs(q[2]) + q[axis] * abs(p[2])
                low = -np.inf if crossing <= 0 else low
                high = np.inf if crossing >= 0 else high
    return max(low, -1.0), min(high, float(size))


@compiled
def nearest_at_centres(points: np.ndarray, faces: np.ndarray, inverse_depth: np.ndarray, nearest: np.ndarray) -> None:
    """Enter faces ``(F, 3)`` of :func:`projected` points into ``(H, W)`` inverse depths and nearest faces."""
    height, width = inverse_depth.shape
    for face in range(len(faces)):
        p0, p1, p2 = _point(points, faces[face, 0]), _point(points, faces[face, 1]), _point(points, faces[face, 2])
        left, right = _reach(p0, p1, p2, 0, width)
        top, bottom = _reach(p0, p1, p2, 1, height)
        if left > right or top > bottom:
            continue
        first, last = max(int(np.ceil(left)), 0), min(int(np.floor(right)), width - 1)
        if first > last:
            continue
        edges = _edges(p0, p1, p2)
        for v in range(max(int(np.ceil(top)), 0), min(int(np.floor(bottom)), height - 1) + 1):
            for u in range(first, last + 1):
                e0, e1, e2 = _weights(edges, u, v)
                value = _inverse_depth(e0, e1, e2, p0[2], p1[2], p2[2])
                if value > inverse_depth[v, u]:
                    inverse_depth[v, u] = value
                    nearest[v, u] = face


@compiled
def nearest_at_points(
    points: np.ndarray, faces: np.ndarray, uv: np.ndarray, least: np.ndarray, width: int, height: int
) -> tuple[np.ndarray, np.ndarray]:
    """The same at image points ``(N, 2)``: ``(N,)`` inverse depths, if above the least, and faces, -1 for none.

    Points are sorted into the pixels of the image that they lie in, so that a face asks few of them; what lies in none
    meets nothing (Aila & Laine, "Alias-free shadow maps", 2004).
    """
    # the points of a pixel are those from its start to the start of the next one
    start, pixel = np.zeros(width * height + 1, np.int32), np.full(len(uv), -1, np.int32)
    for number in range(len(uv)):
        u, v = np.rint(uv[number, 0]), np.rint(uv[number, 1])
        if 0 <= u < width and 0 <= v < height:
            pixel[number] = int(v) * width + int(u)
            start[pixel[number] + 1] += 1
    for number in range(width * height):
        start[number + 1] += start[number]
    order, filled = np.empty(start[-1], np.int32), start[:-1].copy()
    placed = np.empty((3, len(order)))
    for number in range(len(uv)):
        if pixel[number] >= 0:
            place = filled[pixel[number]]
            filled[pixel[number]] += 1
            order[place], placed[0, place], placed[1, place] = number, uv[number, 0], uv[number, 1]
            placed[2, place] = least[number]
    inverse_depth, nearest = least.copy(), np.full(len(uv), -1, np.int32)
    for face in range(len(faces)):
        p0, p1, p2 = _point(points, faces[face, 0]), _point(points, faces[face, 1]), _point(points, faces[face, 2])
        left, right = _reach(p0, p1, p2, 0, width)
        top, bottom = _reach(p0, p1, p2, 1, height)
        if left > right or top > bottom:
            continue
        first, last = max(int(np.rint(left)), 0), min(int(np.rint(right)), width - 1)
        edges = _edges(p0, p1, p2)
        a0, b0, c0, a1, b1, c1, a2, b2, c2 = edges
        # which is the same at all points, so that the weights over it have the inverse depth as their sum
        d = c0 * p0[2] + c1 * p1[2] + c2 * p2[2]
        if first > last or d == 0:
            continue
        shares = a0 / d, b0 / d, c0 / d, a1 / d, b1 / d, c1 / d, a2 / d, b2 / d, c2 / d
        for row in range(max(int(np.rint(top)), 0), min(int(np.rint(bottom)), height - 1) + 1):
            for place in range(start[row * width + first], start[row * width + last + 1]):
                u, v, value = placed[0, place], placed[1, place], placed[2, place]
                e0, e1, e2 = _weights(shares, u, v)
                # one condition that seldom holds: processors foresee that, but not each of its parts
                if min(e0, e1, e2, e0 + e1 + e2 - value) >= -OUTSIDE * value:
                    e0, e1, e2 = _weights(edges, u, v)
                    value = _inverse_depth(e0, e1, e2, p0[2], p1[2], p2[2])
                    if value > placed[2, place]:
                        placed[2, place] = value
                        inverse_depth[order[place]], nearest[order[place]] = value, face
    return inverse_depth, nearest


@compiled
def corner_areas(points: np.ndarray, corners: tuple[int, int, int], u: float, v: float) -> tuple[float, float, float]:
    """The weights of the corners of a face at an image point, with fewer products for one; below 0 on its front."""
    a, b, c = corners
    z0, z1, z2 = points[a, 2], points[b, 2], points[c, 2]
    x0, x1, x2 = points[a, 0] - u * z0, points[b, 0] - u * z1, points[c, 0] - u * z2
    y0, y1, y2 = points[a, 1] - v * z0, points[b, 1] - v * z1, points[c, 1] - v * z2
    return x1 * y2 - y1 * x2, x2 * y0 - y2 * x0, x0 * y1 - y0 * x1
