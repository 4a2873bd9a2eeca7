"""A CT volume and a map of labels: voxels and where they lie.

Arrays are indexed ``[z, y, x]``; a point in *index* space is ``(x, y, z)``, with the **centres** of the voxels at whole
numbers. ``mesh_from_index`` takes it to the CT's patient coordinates LPS (x to the left, y to the back, z to the head),
mm, which are the frame of every mesh made from the volume.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ..errors import InputError
from ..transforms import transform_points


@dataclass(frozen=True)
class VoxelGrid:
    """Where voxels lie.

    Attributes
    ----------
    size
        Number of voxels along x, y and z.
    mesh_from_index
        ``(4, 4)``; its columns may be oblique to the patient's axes, but are orthogonal.
    """

    size: tuple[int, int, int]
    mesh_from_index: np.ndarray

    @cached_property
    def spacing_mm(self) -> np.ndarray:
        """``(3,)`` distances between voxels along x, y and z."""
        return np.linalg.norm(self.mesh_from_index[:3, :3], axis=0)

    @property
    def voxel_mm3(self) -> float:
        """Volume of a voxel."""
        return float(np.prod(self.spacing_mm))

    @property
    def is_left_handed(self) -> bool:
        """Whether the axes of the index are mirrored: faces made in index space then show their backs."""
        return bool(np.linalg.det(self.mesh_from_index[:3, :3]) < 0)

    @cached_property
    def index_from_mesh(self) -> np.ndarray:
        """``(4, 4)``, the inverse of ``mesh_from_index``."""
        return np.linalg.inv(self.mesh_from_index)

    def box_of(self, lower_mm: np.ndarray, upper_mm: np.ndarray, where: str) -> tuple[np.ndarray, np.ndarray]:
        """First and one past the last voxel, ``(3,)`` each as (x, y, z), that cover a box in LPS between two corners.

        Raises
        ------
        InputError
            The box holds no voxel.
        """
        corners = np.array(np.meshgrid(*np.stack([lower_mm, upper_mm], axis=1))).reshape(3, -1).T
        index = transform_points(self.index_from_mesh, corners)
        first = np.maximum(np.floor(index.min(axis=0)), 0).astype(int)
        stop = np.minimum(np.ceil(index.max(axis=0)) + 1, self.size).astype(int)
        if (stop <= first).any():
            raise InputError(
                f"{where}: expected a box in the volume, found {np.round(lower_mm, 1).tolist()} to "
                f"{np.round(upper_mm, 1).tolist()} mm outside it; it covers "
                f"{np.round(self.bounds_mm[0], 1).tolist()} to {np.round(self.bounds_mm[1], 1).tolist()} mm (LPS)"
            )
        return first, stop

    @cached_property
    def bounds_mm(self) -> np.ndarray:
        """``(2, 3)`` smallest and largest LPS coordinates of the voxels' centres."""
        ends = np.array(np.meshgrid(*[(0, count - 1) for count in self.size])).reshape(3, -1).T
        points = transform_points(self.mesh_from_index, ends.astype(np.float64))
        return np.stack([points.min(axis=0), points.max(axis=0)])

    def shifted(self, first: np.ndarray, size: tuple[int, int, int]) -> "VoxelGrid":
        """The grid of ``size`` voxels that begins at voxel ``first`` (x, y, z) of this one."""
        moved = self.mesh_from_index.copy()
        moved[:3, 3] = transform_points(self.mesh_from_index, np.asarray(first, np.float64)[None])[0]
        return VoxelGrid(size, moved)


@dataclass(frozen=True)
class Volume:
    """A CT.

    Attributes
    ----------
    values
        ``(Z, Y, X)`` int16, Hounsfield units; never written to.
    grid
        Where the voxels lie.
    """

    values: np.ndarray
    grid: VoxelGrid

    def cropped(self, lower_mm: np.ndarray, upper_mm: np.ndarray, where: str = "crop box") -> "Volume":
        """The voxels that cover a box in LPS, mm, as a view.

        Raises
        ------
        InputError
            The box lies outside the volume.
        """
        values, grid = _cropped(self.values, self.grid, lower_mm, upper_mm, where)
        return replace(self, values=values, grid=grid)


@dataclass(frozen=True)
class LabelMap:
    """A segmentation: one label per voxel.

    Attributes
    ----------
    values
        ``(Z, Y, X)`` unsigned integers, 0 for the background; never written to.
    grid
        Where the voxels lie.
    names
        Names of the labels that occur, by value, without the background.
    """

    values: np.ndarray
    grid: VoxelGrid
    names: Mapping[int, str]

    def cropped(self, lower_mm: np.ndarray, upper_mm: np.ndarray, where: str = "crop box") -> "LabelMap":
        """The voxels that cover a box in LPS, mm, as a view, with the names of all labels.

        Raises
        ------
        InputError
            The box lies outside the map.
        """
        values, grid = _cropped(self.values, self.grid, lower_mm, upper_mm, where)
        return replace(self, values=values, grid=grid)


def _cropped(
    values: np.ndarray, grid: VoxelGrid, lower_mm: np.ndarray, upper_mm: np.ndarray, where: str
) -> tuple[np.ndarray, VoxelGrid]:
    first, stop = grid.box_of(lower_mm, upper_mm, where)
    part = values[first[2] : stop[2], first[1] : stop[1], first[0] : stop[0]]
    return part, grid.shifted(first, tuple(int(count) for count in stop - first))  # type: ignore[arg-type]


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
