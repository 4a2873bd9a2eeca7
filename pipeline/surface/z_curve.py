"""Places along a Z curve: numbers that are close for points that are.

Source: Morton, "A computer oriented geodetic data base and a new technique in file sequencing" (1966).
"""

from dataclasses import dataclass

import numpy as np

_SPREAD = (
    (32, 0x1F00000000FFFF),
    (16, 0x1F0000FF0000FF),
    (8, 0x100F00F00F00F00F),
    (4, 0x10C30C30C30C30C3),
    (2, 0x1249249249249249),
)


@dataclass(frozen=True)
class ZCurve:
    """A curve through a cube of cells.

    Attributes
    ----------
    origin, size_mm
        ``(3,)`` lower corner of the cube, mm, and its side.
    cells
        Along a side, a power of two up to ``2**20``.
    """

    origin: np.ndarray
    size_mm: float
    cells: int

    def places(self, points: np.ndarray) -> np.ndarray:
        """``(N,)`` int64 places of points ``(N, 3)``, mm: the bits of the three cell numbers interleaved."""
        place = np.zeros(len(points), np.int64)
        for axis in range(3):
            cell = (points[:, axis] - self.origin[axis]) / (max(self.size_mm, 1e-150) / self.cells)
            bits = np.clip(cell, 0, self.cells - 1).astype(np.int64)
            for shift, mask in _SPREAD:
                bits = (bits | (bits << shift)) & mask
            place |= bits << axis
        return place
