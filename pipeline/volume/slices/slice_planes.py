"""The three planes of voxels that lie nearest to axial, coronal and sagittal: slices without interpolation.

Each is shown as radiologists look at it: from the feet, from the front, from the left.
"""

from dataclasses import dataclass
from itertools import permutations

import numpy as np

from ...transforms import transform_points
from ..volume import VoxelGrid

_VIEWS = (("axial", 2, 0, 1, "RLAP"), ("coronal", 1, 0, 2, "RLSI"), ("sagittal", 0, 1, 2, "APSI"))
"""Name; axes of LPS across the plane, to the right and down (z runs up); directions left, right, top and bottom."""


@dataclass(frozen=True)
class SlicePlane:
    """How the slices of one direction are cut and shown.

    A pixel ``(u, v)`` has its centre at whole numbers, (0, 0) at the top left.

    Attributes
    ----------
    name
        ``"axial"``, ``"coronal"`` or ``"sagittal"``.
    grid
        The voxels.
    axes
        Axes of the index (0 for x) across the plane, to the right and down.
    reversed_axes
        Whether the index falls to the right, and down.
    directions
        The patient's sides at the left, right, top and bottom of the picture, such as ``"RLAP"``.
    """

    name: str
    grid: VoxelGrid
    axes: tuple[int, int, int]
    reversed_axes: tuple[bool, bool]
    directions: str

    @property
    def count(self) -> int:
        """Number of slices."""
        return self.grid.size[self.axes[0]]

    @property
    def size_wh(self) -> tuple[int, int]:
        """Width and height of a slice in voxels."""
        return self.grid.size[self.axes[1]], self.grid.size[self.axes[2]]

    @property
    def pixel_mm(self) -> tuple[float, float]:
        """Width and height of a pixel."""
        return float(self.grid.spacing_mm[self.axes[1]]), float(self.grid.spacing_mm[self.axes[2]])

    def slice_of(self, values: np.ndarray, number: int) -> np.ndarray:
        """``(H, W)``: one slice of ``(Z, Y, X)`` values, the top row first."""
        return self.oriented(np.take(values, number, axis=2 - self.axes[0]))

    def oriented(self, part: np.ndarray) -> np.ndarray:
        """``(H, W)`` view of what indexing leaves of ``(z, y, x)`` in one slice, the top row first."""
        _, right, down = self.axes
        # rows are the higher axis of the index
        part = part if down > right else part.T
        reversed_right, reversed_down = self.reversed_axes
        return part[:: -1 if reversed_down else 1, :: -1 if reversed_right else 1]

    def place_of(self, point_mm: np.ndarray) -> tuple[float, float, float]:
        """Number of the slice, and pixel u and v, with fractions, of a point ``(3,)`` in LPS."""
        index = transform_points(self.grid.index_from_mesh, np.asarray(point_mm, np.float64)[None])[0]
        across, right, down = self.axes
        width, height = self.size_wh
        u = width - 1 - index[right] if self.reversed_axes[0] else index[right]
        v = height - 1 - index[down] if self.reversed_axes[1] else index[down]
        return float(index[across]), float(u), float(v)

    def point_at(self, number: float, u: float, v: float) -> np.ndarray:
        """``(3,)`` LPS, mm, of a pixel of a slice, the inverse of :meth:`place_of`."""
        across, right, down = self.axes
        width, height = self.size_wh
        index = np.empty(3)
        index[across] = number
        index[right] = width - 1 - u if self.reversed_axes[0] else u
        index[down] = height - 1 - v if self.reversed_axes[1] else v
        return transform_points(self.grid.mesh_from_index, index[None])[0]


def slice_planes(grid: VoxelGrid) -> tuple[SlicePlane, SlicePlane, SlicePlane]:
    """The planes of a grid of voxels: axial, coronal, sagittal; of oblique voxels, those that come nearest to them."""
    columns = grid.mesh_from_index[:3, :3] / grid.spacing_mm
    # the axis of the index for each axis of LPS: of all assignments, the one that turns them least
    axis_of = max(permutations(range(3)), key=lambda order: sum(abs(columns[lps, order[lps]]) for lps in range(3)))
    planes = []
    for name, across, right, down, directions in _VIEWS:
        # LPS z runs up the picture
        falls = columns[down, axis_of[down]] > 0 if down == 2 else columns[down, axis_of[down]] < 0
        axes = axis_of[across], axis_of[right], axis_of[down]
        reversed_axes = bool(columns[right, axis_of[right]] < 0), bool(falls)
        planes.append(SlicePlane(name, grid, axes, reversed_axes, directions))
    axial, coronal, sagittal = planes
    return axial, coronal, sagittal
