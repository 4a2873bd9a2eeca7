"""Rasterise many 2D triangles at once: which integer pixel centres lie in which triangle, with barycentrics.

Pure numpy. Triangles are sorted by the size of their bounding boxes, and each size class is tested as one dense array
of edge functions (Pineda 1988), so a million triangles of one pixel cost about as much as one of a million pixels.
"""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

CHUNK = 1 << 20
"""Largest number of candidate pixels of one box; larger boxes are cut."""

BLOCK = 1 << 16
"""Number of candidate pixels tested at once, unless one box has more: few enough for a processor's cache."""

MANTISSA_BITS = 25
"""Bits of a coordinate for which an edge function is exact in float64: 2 (25 + 1) + 1 = 53."""


class Samples(NamedTuple):
    """Pixel centres in triangles, one row per (triangle, pixel) pair.

    Attributes
    ----------
    triangle, x, y
        ``(N,)`` int64 triangle index and pixel.
    barycentric
        ``(N, 3)`` float64 with sum 1; some are negative outside the triangle (with a ``margin``).
    """

    triangle: np.ndarray
    x: np.ndarray
    y: np.ndarray
    barycentric: np.ndarray

    @property
    def least(self) -> np.ndarray:
        """``(N,)`` smallest barycentric, negative outside the triangle."""
        # column by column: numpy is slow at reductions along an axis of three
        return np.minimum(np.minimum(self.barycentric[:, 0], self.barycentric[:, 1]), self.barycentric[:, 2])


def rasterise(triangles_px: np.ndarray, *, margin: float = 0.0, chunk: int = CHUNK) -> Iterator[Samples]:
    """All integer pixel centres in each triangle, in pieces of bounded size and no particular order.

    Parameters
    ----------
    triangles_px
        ``(T, 3, 2)`` finite corners in px, either orientation, at most about 1e5 px from the origin.
    margin
        Grows every triangle by a square of this half-width, px (Minkowski sum). 0.5 gives the pixels that a triangle
        touches ("conservative rasterisation"), 1 the texels that bilinear lookups inside it read.
    chunk
        Largest number of candidate pixels tested at once.

    Notes
    -----
    With ``margin=0`` the triangles of a triangulated region partition its pixel centres: a centre on a shared edge
    or vertex belongs to exactly one of them, as if it were moved right by an infinitesimal and down by a smaller one.
    To this end, corners are rounded to a dyadic grid on which edge functions are exact (as in hardware; at worst
    1/1024 px for coordinates up to 16384 px). The rule fails only where the rounding inverts a triangle. Barycentrics
    use the unrounded corners. Triangles without area cover nothing or, with a margin, the pixels around their segment.
    """
    if len(triangles_px) == 0:
        return
    largest = max(float(triangles_px.max()), -float(triangles_px.min())) + margin + 1
    fraction_bits = MANTISSA_BITS - int(np.ceil(np.log2(largest)))
    corners = np.round(np.ldexp(triangles_px, fraction_bits))
    corners = np.ldexp(corners, -fraction_bits)
    direction = corners[:, [1, 2, 0]] - corners
    area2 = direction[:, 0, 0] * direction[:, 1, 1] - direction[:, 0, 1] * direction[:, 1, 0]
    # orient all edges so that edge functions are positive inside
    direction[area2 < 0] *= -1
    if margin > 0:
        threshold = -margin * np.abs(direction).sum(axis=2)
    else:
        owns_ties = (direction[..., 1] < 0) | ((direction[..., 1] == 0) & (direction[..., 0] > 0))
        threshold = np.where(owns_ties, 0.0, np.ldexp(1.0, -2 * fraction_bits))
    gradients = _gradients(triangles_px)
    # corner by corner: numpy is slow at reductions along an axis of three
    a, b, c = corners[:, 0], corners[:, 1], corners[:, 2]
    low = np.ceil(np.minimum(np.minimum(a, b), c) - margin).astype(np.int64)
    size = np.floor(np.maximum(np.maximum(a, b), c) + margin).astype(np.int64) - low + 1
    kept = np.flatnonzero((size[:, 0] > 0) & (size[:, 1] > 0) & ((area2 != 0) | (margin > 0)))
    for index, start, stop, (width, height) in _boxes(kept, low, size, chunk):
        # boxes along the last axis: numpy is slow at short ones
        x = start[:, 0] + np.arange(width)[:, None]
        y = start[:, 1] + np.arange(height)[:, None]
        inside = (x < stop[:, 0]) & (y < stop[:, 1])[:, None]
        for edge in range(3):
            origin, along = corners[index, edge].T, direction[index, edge].T
            down = along[0] * (y - origin[1])
            across = along[1] * (x - origin[0])
            inside &= down[:, None] - across >= threshold[index, edge]
        found = np.flatnonzero(inside.transpose(2, 0, 1))
        row = found // (width * height)
        j = (found - row * (width * height)) // width
        i = found - (row * height + j) * width
        triangle, x, y = index[row], start[row, 0] + i, start[row, 1] + j
        yield Samples(triangle, x, y, _weights(gradients[triangle], x, y))


def barycentric(triangles_px: np.ndarray, points_px: np.ndarray) -> np.ndarray:
    """``(N, 3, 2)`` triangles, ``(N, 2)`` points -> ``(N, 3)`` barycentrics; 1/3 each in a triangle without area."""
    return _weights(_gradients(triangles_px), points_px[:, 0], points_px[:, 1])


def nearest_barycentric(triangles_px: np.ndarray, points_px: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Nearest points of ``(N, 3, 2)`` triangles to ``(N, 2)`` points *outside* them.

    Returns
    -------
    ``(N, 3)`` barycentrics, all in [0, 1], and ``(N,)`` distances in px.
    """
    best = np.zeros((len(points_px), 3))
    distance = np.full(len(points_px), np.inf)
    # column by column: numpy is slow at reductions along an axis of two
    for a, b in ((0, 1), (1, 2), (2, 0)):
        along_x, along_y = (triangles_px[:, b] - triangles_px[:, a]).T
        right, down = (points_px - triangles_px[:, a]).T
        squared = along_x * along_x + along_y * along_y
        t = right * along_x + down * along_y
        t = np.clip(np.divide(t, squared, out=np.zeros_like(t), where=squared > 0), 0, 1)
        right, down = right - t * along_x, down - t * along_y
        here = np.sqrt(right * right + down * down)
        nearer = here < distance
        distance[nearer] = here[nearer]
        best[nearer] = 0
        best[nearer, a], best[nearer, b] = 1 - t[nearer], t[nearer]
    return best, distance


def _gradients(triangles_px: np.ndarray) -> np.ndarray:
    """``(T, 3, 2)`` -> ``(T, 7)``: x and y derivatives of barycentrics 1 and 2, their value at corner 0, corner 0."""
    a = triangles_px[:, 0]
    (bx, by), (cx, cy) = (triangles_px[:, 1] - a).T, (triangles_px[:, 2] - a).T
    area2 = bx * cy - by * cx
    flat = np.abs(area2) <= 1e-12 * np.maximum(bx * bx + by * by, cx * cx + cy * cy)
    inverse = np.divide(1.0, area2, out=np.zeros_like(area2), where=~flat)
    third = np.where(flat, 1 / 3, 0.0)
    return np.stack([cy * inverse, -cx * inverse, -by * inverse, bx * inverse, third, a[:, 0], a[:, 1]], axis=1)


def _weights(gradients: np.ndarray, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """``(N, 7)`` gradients and the points' coordinates ``(N,)`` -> ``(N, 3)`` barycentrics."""
    weights = np.empty((len(x), 3))
    right, down = x - gradients[:, 5], y - gradients[:, 6]
    weights[:, 1] = right * gradients[:, 0] + down * gradients[:, 1] + gradients[:, 4]
    weights[:, 2] = right * gradients[:, 2] + down * gradients[:, 3] + gradients[:, 4]
    weights[:, 0] = 1 - weights[:, 1] - weights[:, 2]
    return weights


def _boxes(
    kept: np.ndarray, low: np.ndarray, size: np.ndarray, chunk: int
) -> Iterator[tuple[np.ndarray, np.ndarray, np.ndarray, tuple[int, int]]]:
    """Bounding boxes in groups of one size class: triangle indices, first and end pixels ``(n, 2)``, size of the class.

    Boxes larger than a chunk are first cut into bands of rows.
    """
    rows = np.maximum(chunk // size[kept, 0], 1)
    bands = -(-size[kept, 1] // rows)
    index = np.repeat(kept, bands)
    rows = np.repeat(rows, bands)
    start, stop = low[index], low[index] + size[index]
    start[:, 1] += rows * (np.arange(len(index)) - np.repeat(np.cumsum(bands) - bands, bands))
    stop[:, 1] = np.minimum(stop[:, 1], start[:, 1] + rows)
    class_size = _size_class(stop - start)
    key = class_size[:, 0] << 32 | class_size[:, 1]
    order = np.argsort(key, kind="stable")
    firsts = np.flatnonzero(np.diff(key[order], prepend=-1))
    for first, end in zip(firsts, np.append(firsts, len(order))[1:], strict=True):
        width, height = (int(length) for length in class_size[order[first]])
        step = max(min(chunk, BLOCK) // (width * height), 1)
        for begin in range(first, end, step):
            group = order[begin : min(begin + step, end)]
            yield index[group], start[group], stop[group], (width, height)


def _size_class(length: np.ndarray) -> np.ndarray:
    """Round up to three significant binary digits: few classes, little waste."""
    step = 1 << np.maximum(np.frexp(length.astype(np.float64))[1] - 3, 0).astype(np.int64)
    return -(-length // step) * step
