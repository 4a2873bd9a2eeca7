"""What a frame knows of points of a surface, and values of the surface's vertices at them.

N points are given by the image points ``uv`` ``(N, 2)`` of a view that show them, the faces that they lie on, and their
inverse depths. A point's homogeneous pixel in a frame is A (u, v, 1) + b w, with w the inverse depth, so that at the
frame's own pose each pixel is looked up at its own place.
"""

import numpy as np

from .compiled import compiled


@compiled
def _pixels_around(height: int, width: int, x: float, y: float) -> tuple[int, int, int, int, float, float]:
    """Rows above and below a place, columns left and right, and how far it is from the first; moved in if outside."""
    x, y = min(max(x, 0.0), width - 1.0), min(max(y, 0.0), height - 1.0)
    left, top = min(int(x), max(width - 2, 0)), min(int(y), max(height - 2, 0))
    return top, min(top + 1, height - 1), left, min(left + 1, width - 1), x - left, y - top


@compiled
def fronts(cross: np.ndarray, offsets: np.ndarray, face: np.ndarray, centre: np.ndarray) -> np.ndarray:
    """``(N,)`` bool: a face, of planes ``cross . x = offset``, shows a viewpoint its front."""
    front = np.empty(len(face), np.bool_)
    for number in range(len(face)):
        normal = cross[face[number]]
        front[number] = normal[0] * centre[0] + normal[1] * centre[1] + normal[2] * centre[2] > offsets[face[number]]
    return front


@compiled
def placed_in_frame(
    uv: np.ndarray, inverse_depth: np.ndarray, affine: np.ndarray, surface: np.ndarray, tolerance: float, margin: float
) -> tuple[np.ndarray, np.ndarray]:
    """Column, row and depth ``(N, 3)`` in a frame, and ``(N,)`` bool: the frame shows the point.

    ``affine`` is ``(3, 4)``, A and b; ``surface`` ``(H, W)`` the inverse depth of what the frame shows, which the
    point's own may differ from by a relative ``tolerance``; pixels may be outside by a ``margin``.
    """
    places, shown = np.zeros((len(uv), 3)), np.zeros(len(uv), np.bool_)
    height, width = surface.shape
    for number in range(len(uv)):
        u, v, w = uv[number, 0], uv[number, 1], inverse_depth[number]
        z = affine[2, 0] * u + affine[2, 1] * v + affine[2, 2] + affine[2, 3] * w
        if z <= 0:
            continue
        x = (affine[0, 0] * u + affine[0, 1] * v + affine[0, 2] + affine[0, 3] * w) / z
        y = (affine[1, 0] * u + affine[1, 1] * v + affine[1, 2] + affine[1, 3] * w) / z
        if not (-margin <= x <= width - 1 + margin and -margin <= y <= height - 1 + margin):
            continue
        depth = z / w
        places[number, 0], places[number, 1], places[number, 2] = x, y, depth
        top, below, left, right, across, down = _pixels_around(height, width, x, y)
        upper = surface[top, left] * (1 - across) + surface[top, right] * across
        lower = surface[below, left] * (1 - across) + surface[below, right] * across
        shown[number] = abs((upper * (1 - down) + lower * down) * depth - 1) <= tolerance
    return places, shown


@compiled
def looked_up(
    image: np.ndarray, places: np.ndarray, chosen: np.ndarray, offsets: np.ndarray, share: float, tolerance: float
) -> np.ndarray:
    """``(N, 4)`` float32 values of an image ``(H, W, 4)`` at the ``(N, 3)`` places that are ``(N,)`` bool chosen.

    The first three channels are means over lookups at ``offsets`` ``(K, 2)``, of which a ``share`` is replaced by the
    nearest texel's, if that shows the point's surface: then the fourth channel, its inverse depth, fits within the
    relative ``tolerance``. The fourth one is the first lookup's.
    """
    values, count, sums = np.zeros((len(places), 4), np.float32), len(offsets), np.empty(4)
    height, width = image.shape[:2]
    for number in range(len(places)):
        if not chosen[number]:
            continue
        x, y, depth = places[number, 0], places[number, 1], places[number, 2]
        row, column = min(max(int(np.rint(y)), 0), height - 1), min(max(int(np.rint(x)), 0), width - 1)
        part = share if share > 0 and abs(image[row, column, 3] * depth - 1) <= tolerance else 0.0
        for lookup in range(count):
            top, below, left, right, across, down = _pixels_around(
                height, width, x + offsets[lookup, 0], y + offsets[lookup, 1]
            )
            for channel in range(3 if lookup else 4):
                upper = image[top, left, channel] * (1 - across) + image[top, right, channel] * across
                lower = image[below, left, channel] * (1 - across) + image[below, right, channel] * across
                sums[channel] = (sums[channel] if lookup else 0.0) + (upper * (1 - down) + lower * down)
        for channel in range(3):
            value = sums[channel] / count
            values[number, channel] = value + part * (image[row, column, channel] - value)
        values[number, 3] = sums[3]
    return values


@compiled
def interpolated(values: np.ndarray, faces: np.ndarray, face: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """``(N, C)`` float32 means of values ``(V, C)`` of vertices with the weights ``(N, 3)`` of the faces' corners."""
    means = np.empty((len(face), values.shape[1]), np.float32)
    for number in range(len(face)):
        a, b, c = faces[face[number], 0], faces[face[number], 1], faces[face[number], 2]
        for channel in range(values.shape[1]):
            means[number, channel] = (
                weights[number, 0] * values[a, channel]
                + weights[number, 1] * values[b, channel]
                + weights[number, 2] * values[c, channel]
            )
    return means


@compiled
def shading_normals(
    normals: np.ndarray, cross: np.ndarray, faces: np.ndarray, face: np.ndarray, weights: np.ndarray, front: np.ndarray
) -> np.ndarray:
    """``(N, 3)`` float32 unit normals between those ``(V, 3)`` of the vertices, on the side that is seen: front or not.

    Where a face of normal ``cross`` is flipped among others, its vertices' normals are turned to its front.
    """
    means = np.empty((len(face), 3), np.float32)
    mean = np.empty(3)
    for number in range(len(face)):
        towards, squared = 0.0, 0.0
        for axis in range(3):
            mean[axis], total = 0.0, 0.0
            for corner in range(3):
                value = normals[faces[face[number], corner], axis]
                mean[axis] += weights[number, corner] * value
                total += value
            towards += total * cross[face[number], axis]
            squared += mean[axis] * mean[axis]
        scale = 1 / np.sqrt(max(squared, 1e-24))
        if (towards < 0) == front[number]:
            scale = -scale
        for axis in range(3):
            means[number, axis] = mean[axis] * scale
    return means
