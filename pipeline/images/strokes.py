"""Antialiased lines, by the distance of every pixel near them: for pictures made without a library that draws."""

from itertools import product

import numpy as np

STEP_PX = 0.25
"""Distances to lines are those to points at most so far apart."""


def pieces_of(lengths: np.ndarray, longest_px: float = STEP_PX) -> tuple[np.ndarray, np.ndarray]:
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
    share = along.mean(axis=1)[:, None]
    points = (1 - share) * segments[segment, 0] + share * segments[segment, 1]
    # with a border in which every point has all of its surroundings
    radius = int(np.ceil(reach_px + 0.5))
    near = np.full((shape_hw[0] + 4 * radius, shape_hw[1] + 4 * radius), np.inf, np.float32)
    pixel = np.rint(points).astype(np.int64)
    kept = ((pixel >= -radius) & (pixel < np.array(shape_hw[::-1]) + radius)).all(axis=1)
    right, down = (pixel - points)[kept].astype(np.float32).T
    at = (pixel[kept] + 2 * radius) @ [1, near.shape[1]]
    for x, y in product(range(-radius, radius + 1), repeat=2):
        np.minimum.at(near.ravel(), at + y * near.shape[1] + x, np.hypot(right + x, down + y))
    distance = near[2 * radius : -2 * radius, 2 * radius : -2 * radius].ravel()
    touched = np.flatnonzero(distance <= reach_px)
    return touched, distance[touched]


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
