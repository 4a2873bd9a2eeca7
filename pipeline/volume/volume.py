"""A CT volume and a map of labels: voxels and where they lie.

Arrays are indexed ``[z, y, x]``; a point in *index* space is ``(x, y, z)``, with the **centres** of the voxels at whole
numbers. ``mesh_from_index`` takes it to the CT's patient coordinates LPS (x to the left, y to the back, z to the head),
mm, which are the frame of every mesh made from the volume.
"""

from collections.abc import Mapping
from dataclasses import dataclass
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

    @cached_property
    def corners_mm(self) -> np.ndarray:
        """``(8, 3)`` LPS centres of the outermost voxels."""
        return transform_points(self.mesh_from_index, box_corners(np.zeros(3), np.array(self.size) - 1.0))

    @cached_property
    def bounds_mm(self) -> np.ndarray:
        """``(2, 3)`` smallest and largest LPS coordinates of the voxels' centres."""
        return np.stack([self.corners_mm.min(axis=0), self.corners_mm.max(axis=0)])

    def box_of(self, points_mm: np.ndarray | None, where: str) -> tuple[np.ndarray, np.ndarray]:
        """First and one past the last voxel, ``(3,)`` each as (x, y, z), that cover points ``(N, 3)`` in LPS.

        ``None`` stands for the whole volume.
        """
        if points_mm is None:
            return np.zeros(3, int), np.array(self.size)
        index = transform_points(self.index_from_mesh, points_mm)
        first = np.maximum(np.floor(index.min(axis=0)), 0).astype(int)
        stop = np.minimum(np.ceil(index.max(axis=0)) + 1, self.size).astype(int)
        if (stop <= first).any():
            found, own = (
                f"{np.round(lower, 1).tolist()} to {np.round(upper, 1).tolist()} mm"
                for lower, upper in ((points_mm.min(axis=0), points_mm.max(axis=0)), self.bounds_mm)
            )
            raise InputError(f"{where}: expected a box in the volume, found {found} outside it; it covers {own} (LPS)")
        return first, stop

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
    whole
        The grid of the file from which they were cropped; ``None`` if they were not.
    """

    values: np.ndarray
    grid: VoxelGrid
    whole: VoxelGrid | None = None


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


def box_corners(lower: np.ndarray, upper: np.ndarray) -> np.ndarray:
    """``(8, 3)`` corners of the box between two of them, ``(3,)`` each."""
    return np.stack(np.meshgrid(*np.stack([lower, upper], axis=1)), axis=-1).reshape(-1, 3)


def box_slices(first: np.ndarray, stop: np.ndarray) -> tuple[slice, ...]:
    """Slices of a ``(z, y, x)`` array from voxel ``first`` (x, y, z) to before ``stop``."""
    return tuple(slice(int(a), int(b)) for a, b in zip(first[::-1], stop[::-1], strict=True))


def box_around(mask: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """First voxel ``(3,)`` (x, y, z) and one past the last of what is not zero in ``(z, y, x)``."""
    planes = [np.flatnonzero(mask.any(axis=tuple(other for other in range(3) if other != axis))) for axis in (2, 1, 0)]
    return np.array([plane[0] for plane in planes]), np.array([plane[-1] + 1 for plane in planes])
