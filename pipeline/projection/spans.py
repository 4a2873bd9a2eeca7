"""Rasterise many 2D triangles as spans: the runs of pixel centres that each triangle covers in each row.

A centre belongs to the triangle that it would lie in if it were moved right by an infinitesimal and down by a smaller
one. Where an edge crosses a row is computed from its upper to its lower
end, so two triangles that share the edge get the same number and share no pixel and leave none out. A pixel can only
be wrong if its centre lies on an edge within rounding.

Nothing is tested pixel by pixel, so the time is that of the spans and of filling them.
"""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

BLOCK = 1 << 16
"""About so many pixels are filled at once: few enough for a processor's cache."""


class Spans(NamedTuple):
    """Runs of pixels in rows, one for each triangle and row that it covers.

    Attributes
    ----------
    triangle, row, first, length
        ``(S,)`` int64 triangle, row, leftmost column and number of pixels, at least 1.
    """

    triangle: np.ndarray
    row: np.ndarray
    first: np.ndarray
    length: np.ndarray


def spans_of(u: np.ndarray, v: np.ndarray, size_wh: tuple[int, int]) -> Spans:
    """The spans of triangles in an image.

    Parameters
    ----------
    u, v
        ``(3, T)`` finite columns and rows of the corners, px, in either orientation.
    size_wh
        (width, height) of the image, to which the spans are clipped.
    """
    width, height = size_wh
    columns = np.arange(u.shape[1])
    # corner by corner: numpy is slow along an axis of three
    top, bottom = _highest(v), _lowest(v)
    ends = (top, 3 - top - bottom, bottom)
    ua, ub, uc = (u[corner, columns] for corner in ends)
    va, vb, vc = (v[corner, columns] for corner in ends)
    middle_is_right = (ub - ua) * (vc - va) > (uc - ua) * (vb - va)
    rows_a, rows_b, rows_c = (np.clip(np.ceil(rows), 0, height).astype(np.int64) for rows in (va, vb, vc))
    # each edge from its upper end, with its own slope: equal to the last bit in both of its triangles
    long = ua, va, _slope(ua, va, uc, vc)
    halves = []
    for short, first_row, last_row in (
        ((ua, va, _slope(ua, va, ub, vb)), rows_a, rows_b), ((ub, vb, _slope(ub, vb, uc, vc)), rows_b, rows_c),
    ):  # fmt: skip
        crossed = np.flatnonzero(last_row > first_row)
        right = middle_is_right[crossed]
        rows, first_row = (last_row - first_row)[crossed], first_row[crossed]
        half = np.repeat(np.arange(len(crossed)), rows)
        row = np.arange(len(half)) + (first_row - np.cumsum(rows) + rows)[half]
        bounds = []
        for on_left in (True, False):
            # the long edge is on the left where the middle corner is on the right
            u0, v0, slope = (
                np.where(right == on_left, one[crossed], other[crossed])[half]
                for one, other in zip(long, short, strict=True)
            )
            bounds.append(np.clip(np.ceil(u0 + (row - v0) * slope), 0, width).astype(np.int64))
        length = bounds[1] - bounds[0]
        kept = np.flatnonzero(length > 0)
        halves.append((crossed[half[kept]], row[kept], bounds[0][kept], length[kept]))
    return Spans(*(np.concatenate(parts) for parts in zip(*halves, strict=True)))


def filled(spans: Spans, width: int) -> Iterator[tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """The pixels of spans, block by block.

    Yields
    ------
    ``(N,)`` index of the span, the pixel's distance in columns from the first one of its span, and its index
    ``row * width + column``.
    """
    ends = np.cumsum(spans.length)
    before = ends - spans.length
    starts = spans.row * width + spans.first
    begin = 0
    while begin < len(ends):
        done = before[begin]
        stop = max(int(np.searchsorted(ends, done + BLOCK, side="right")), begin + 1)
        span = np.repeat(np.arange(begin, stop), spans.length[begin:stop])
        offset = np.arange(done, done + len(span)) - before[span]
        yield span, offset, starts[span] + offset
        begin = stop


def _highest(v: np.ndarray) -> np.ndarray:
    """``(3, T)`` -> ``(T,)`` the corner that is highest in the image; the first of equals."""
    return np.where(v[0] <= v[1], np.where(v[0] <= v[2], 0, 2), np.where(v[1] <= v[2], 1, 2))


def _lowest(v: np.ndarray) -> np.ndarray:
    """``(3, T)`` -> ``(T,)`` the corner that is lowest in the image; the last of equals."""
    return np.where(v[2] >= v[1], np.where(v[2] >= v[0], 2, 0), np.where(v[1] >= v[0], 1, 0))


def _slope(ua: np.ndarray, va: np.ndarray, ub: np.ndarray, vb: np.ndarray) -> np.ndarray:
    """Columns per row; 0 for edges along a row, which are never asked for."""
    down = vb - va
    return np.divide(ub - ua, down, out=np.zeros_like(down), where=down > 0)
