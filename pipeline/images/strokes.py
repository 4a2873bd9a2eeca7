"""Antialiased lines, by the distance of every pixel near them: for pictures made without a library that draws."""

from itertools import pairwise

import numpy as np

LONGEST_PX = 4.0
"""Longer segments are cut, so that the pixels near each lie in a small square."""

SIZES_PX = (1.2, 2.4)
"""Pieces up to these lengths have smaller squares."""

_BLOCK = 1 << 16
"""Pixels whose distance is computed at a time."""


def pieces_of(lengths: np.ndarray, longest_px: float = LONGEST_PX) -> tuple[np.ndarray, np.ndarray]:
    """``(N,)`` lengths -> ``(M,)`` segment of each piece, ``(M, 2)`` where on it the piece begins and ends, 0..1."""
    count = np.maximum(np.ceil(lengths / longest_px), 1).astype(np.int64)
    segment = np.repeat(np.arange(len(count)), count)
    number = np.arange(len(segment)) - np.repeat(np.cumsum(count) - count, count)
    return segment, np.stack([number, number + 1], axis=1) / count[segment, None]


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
    segment, along = pieces_of(np.hypot(*(segments[:, 1] - segments[:, 0]).T))
    start, direction = segments[segment, 0], segments[segment, 1] - segments[segment, 0]
    pieces = start[:, None] + along[:, :, None] * direction[:, None]
    radius = _radius(reach_px, LONGEST_PX)
    middle = np.rint(0.5 * (pieces[:, 0] + pieces[:, 1]))
    kept = ((middle >= -radius) & (middle < np.array(shape_hw[::-1]) + radius)).all(axis=1)
    if not kept.any():
        return np.zeros(0, np.int64), np.zeros(0, np.float32)
    pieces, middle = pieces[kept], middle[kept].astype(np.int64)
    # in the part of the image that they lie in
    low = np.maximum(middle.min(axis=0) - radius, 0)
    width, height = np.minimum(middle.max(axis=0) + radius + 1, shape_hw[::-1]) - low
    near = np.full((height, width), np.inf, np.float32)
    pieces, middle = pieces - low, middle - low
    length = np.hypot(*(pieces[:, 1] - pieces[:, 0]).T)
    for shortest, longest in pairwise((-1.0, *SIZES_PX, LONGEST_PX + 1e-6)):
        of_size = (length > shortest) & (length <= longest)
        _lower(near, pieces[of_size], middle[of_size], _radius(reach_px, longest), reach_px)
    near = near.ravel()
    touched = np.flatnonzero(near <= reach_px)
    row, column = np.divmod(touched, width)
    return (row + low[1]) * shape_hw[1] + column + low[0], near[touched]


def _radius(reach_px: float, length_px: float) -> int:
    """Half the side of the square of pixels around the middle of a piece in which all within reach lie."""
    return int(np.ceil(reach_px + length_px / 2 + 0.5))


def _lower(near: np.ndarray, pieces: np.ndarray, middle: np.ndarray, radius: int, reach_px: float) -> None:
    """Lower ``(H, W)`` distances to those to ``(N, 2, 2)`` pieces with ``(N, 2)`` middles, in squares around these."""
    height, width = near.shape
    offset = np.arange(-radius, radius + 1)
    step = max(_BLOCK // len(offset) ** 2, 1)
    for begin in range(0, len(pieces), step):
        part, pixel = pieces[begin : begin + step], middle[begin : begin + step]
        (ax, ay), (bx, by) = ((part[:, end] - pixel).astype(np.float32).T for end in (0, 1))
        dx, dy = bx - ax, by - ay
        squared = np.maximum(dx * dx + dy * dy, np.float32(1e-12))
        # (piece, row, column)
        right = offset.astype(np.float32) - ax[:, None]
        down = offset.astype(np.float32) - ay[:, None]
        along = (right * (dx / squared)[:, None])[:, None, :] + (down * (dy / squared)[:, None])[:, :, None]
        np.clip(along, 0, 1, out=along)
        across = right[:, None, :] - along * dx[:, None, None]
        along *= -dy[:, None, None]
        along += down[:, :, None]
        distance = np.sqrt(across * across + along * along)
        x, y = pixel[:, 0, None] + offset, pixel[:, 1, None] + offset
        inside = ((x >= 0) & (x < width))[:, None, :] & ((y >= 0) & (y < height))[:, :, None] & (distance <= reach_px)
        index = (y[:, :, None] * width + x[:, None, :])[inside]
        np.minimum.at(near.ravel(), index, distance[inside])


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
