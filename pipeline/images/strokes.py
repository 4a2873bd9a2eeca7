"""Antialiased lines, by the distance of every pixel near them: for pictures made without a library that draws."""

import numpy as np

from ..kernels.compiled import compiled


def line_distance(segments: np.ndarray, shape_hw: tuple[int, int], reach_px: float) -> tuple[np.ndarray, np.ndarray]:
    """The pixels near line segments.

    Parameters
    ----------
    segments
        ``(N, 2, 2)`` ends (x, y), px; they may lie outside the image.
    shape_hw
        Of the image.
    reach_px
        Pixels farther off than this are left out.

    Returns
    -------
    ``(M,)`` index ``row * width + column`` of each pixel in increasing order, and ``(M,)`` float32 distance of its
    centre to the nearest segment, px.
    """
    low = np.clip(np.floor(segments.min(axis=(0, 1)) - reach_px), 0, shape_hw[::-1]).astype(np.int64)
    high = np.clip(np.ceil(segments.max(axis=(0, 1)) + reach_px) + 1, low, shape_hw[::-1]).astype(np.int64)
    # of the part of the image that they lie in
    near = np.full((high - low)[::-1], np.inf, np.float32)
    _lower(near, segments - low, reach_px)
    row, column = np.nonzero(near <= reach_px)
    return (row + low[1]) * shape_hw[1] + column + low[0], near[row, column]


@compiled
def _lower(near: np.ndarray, segments: np.ndarray, reach_px: float) -> None:
    """Lower ``(H, W)`` distances to those to ``(N, 2, 2)`` segments, in the box of each one's surroundings."""
    height, width = near.shape
    for number in range(len(segments)):
        ax, ay, bx, by = segments[number, 0, 0], segments[number, 0, 1], segments[number, 1, 0], segments[number, 1, 1]
        dx, dy = bx - ax, by - ay
        squared = max(dx * dx + dy * dy, 1e-12)
        for row in range(max(int(min(ay, by) - reach_px), 0), min(int(max(ay, by) + reach_px) + 1, height)):
            for column in range(max(int(min(ax, bx) - reach_px), 0), min(int(max(ax, bx) + reach_px) + 1, width)):
                along = min(max(((column - ax) * dx + (row - ay) * dy) / squared, 0.0), 1.0)
                distance = np.hypot(column - ax - along * dx, row - ay - along * dy)
                near[row, column] = min(near[row, column], distance)


def coverage(distance_px: np.ndarray, width_px: float) -> np.ndarray:
    """How much of a pixel a line of this width covers, 0..1; a line below 1 px gets fainter instead of thinner."""
    half = max(width_px, 1.0) / 2
    return np.clip(half + 0.5 - distance_px, 0, 1) * min(width_px, 1.0)


def dashed(position_px: np.ndarray, length_px: float, *, on_px: float, off_px: float) -> np.ndarray:
    """Which points of a closed curve lie on a dash.

    Parameters
    ----------
    position_px
        ``(N,)`` along the curve from its start.
    length_px
        Of the whole curve: the period is fitted so that a whole number of them closes it.
    on_px, off_px
        Wanted length of dash and gap.
    """
    count = max(round(length_px / (on_px + off_px)), 1)
    return (position_px * count / length_px) % 1 < on_px / (on_px + off_px)
