"""A surface in blocks of neighbouring faces, as many as fit into the cache, and those that are worked on at a time."""

import os

import numpy as np

from .z_curve import ZCurve

THREADS = min(os.cpu_count() or 1, 4)
BLOCK_FACES = 100_000
_CELLS = 32
"""Of the Z curve along an axis: their places have 15 bits, which sort fast."""
_SHIFTS, _SCALES = (0.0, 0.37, 0.21), (1.0, 1.6, 1.3)
"""Origin and side of the curve's cube, so that the blocks of two passes have different borders."""


def surface_blocks(points: np.ndarray, number: int = 0) -> list[np.ndarray]:
    """Blocks of about :data:`BLOCK_FACES` faces, each the indices of its faces, rising.

    Parameters
    ----------
    points
        ``(F, 3)`` a point of each face, mm.
    number
        Of the pass.
    """
    if len(points) <= 3 * BLOCK_FACES // 2:
        return [np.arange(len(points))]
    lower, extent = points.min(axis=0), float(np.ptp(points, axis=0).max())
    turn = number % len(_SHIFTS)
    place = ZCurve(lower - _SHIFTS[turn] * extent, _SCALES[turn] * extent, _CELLS).places(points)
    size = np.bincount(place, minlength=_CELLS**3)
    block_of_cell = (np.cumsum(size) - size) * -(-len(points) // BLOCK_FACES) // len(points)
    return [block for block in grouped(block_of_cell[place], int(block_of_cell[-1]) + 1) if len(block)]


def grouped(group: np.ndarray, count: int) -> list[np.ndarray]:
    """The indices of each of ``count`` groups, rising, where ``group`` (N,) tells it, -1 for none."""
    # sorted by digits, as 16 bits are
    order = np.argsort(group.astype(np.int16) if count < 1 << 15 else group, kind="stable")
    ends = np.cumsum(np.bincount(group + 1, minlength=count + 1))
    return np.split(order, ends[:-1])[1:]
