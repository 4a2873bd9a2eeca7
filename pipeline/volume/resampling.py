"""Values of a volume at any points."""

from collections.abc import Callable

import numpy as np

from ..transforms import transform_points
from .volume import VoxelGrid


class Sampler:
    """Points in a grid, for trilinear interpolation of any values on it.

    Parameters
    ----------
    points
        ``(N, 3)`` in the frame of the mesh, mm.
    """

    def __init__(self, grid: VoxelGrid, points: np.ndarray) -> None:
        place = transform_points(grid.index_from_mesh, points).T
        last = np.array(grid.size)[:, None] - 1
        # up to half a voxel outside the outermost centres the nearest counts
        self._within = np.flatnonzero(((place >= -0.5) & (place <= last + 0.5)).all(axis=0))
        place = np.clip(place[:, self._within], 0, last)
        first = np.minimum(place.astype(np.intp), np.maximum(last - 1, 0))
        share = (place - first).astype(np.float32)
        ends = [(first, 1 - share), (np.minimum(first + 1, last), share)]
        self._count = len(points)
        self._corners = [
            ((z[0][2], y[0][1], x[0][0]), x[1][0] * y[1][1] * z[1][2]) for z in ends for y in ends for x in ends
        ]

    def values(
        self, values: np.ndarray, *, outside: float, of: Callable[[np.ndarray], np.ndarray] | None = None
    ) -> np.ndarray:
        """``(N,)`` float32 values at the points.

        Parameters
        ----------
        values
            ``(Z, Y, X)`` on the grid.
        outside
            The value of points outside it.
        of
            Applied to the values before they are interpolated, such as ``lambda labels: labels == 3``.
        """
        total = np.zeros(len(self._within), np.float32)
        for place, weight in self._corners:
            found = values[place]
            total += weight * (found if of is None else of(found))
        result = np.full(self._count, outside, np.float32)
        result[self._within] = total
        return result
