"""Which voxels of a CT are bone: those above a threshold, without islands and tiny holes."""

import numpy as np

from ...errors import InputError
from ..simple_itk import components
from ..volume import Volume, VoxelGrid
from .isosurface import RemovedField

HOLE_MM3 = 1.0
"""Enclosed holes below this volume are noise or marrow; mastoid air cells are larger."""

CRUMB_MM3 = 10.0
"""Parts below this volume that a drill has cut off are washed away."""


def bone_voxels(
    volume: Volume, level_hu: float, *, smallest_mm3: float | None = None, hole_mm3: float = HOLE_MM3
) -> np.ndarray:
    """The voxels of bone, of which :func:`oneframe.volume.bone.isosurface.isosurface` makes the surface.

    Parts are connected by the faces of their voxels, as in the surface. It stays where it is: all neighbours of a
    voxel of bone that are left out lie below the threshold.

    Parameters
    ----------
    level_hu
        Bone lies above it.
    smallest_mm3
        Keep all parts of at least this volume; ``None`` keeps the largest alone, without head-rest and mandible.
    hole_mm3
        Fill holes below this volume that are enclosed in bone; 0 fills none.

    Returns
    -------
    ``(Z, Y, X)`` bool.
    """
    # whole numbers compare faster than halves
    level = int(np.floor(level_hu))
    bone = volume.values > level
    parts = components(bone)
    if len(parts.voxels) == 0:
        raise InputError(
            f"threshold {level_hu:g} HU: expected bone above it, found none; the volume holds {volume.values.min()} to "
            f"{volume.values.max()} HU; choose a lower threshold"
        )
    if smallest_mm3 is None:
        keep = np.arange(len(parts.voxels)) == np.argmax(parts.voxels)
    else:
        keep = parts.voxels * volume.grid.voxel_mm3 >= smallest_mm3
    if not keep.any():
        raise InputError(
            f"islands: expected parts of bone of at least {smallest_mm3:g} mm³, the largest has "
            f"{parts.voxels.max() * volume.grid.voxel_mm3:.3g} mm³; choose a smaller volume"
        )
    bone = parts.chosen(keep)
    if hole_mm3 > 0:
        holes = components(~bone)
        bone |= holes.chosen((holes.voxels * volume.grid.voxel_mm3 < hole_mm3) & ~holes.touching_border)
    return bone


def without_crumbs(
    solid: np.ndarray, grid: VoxelGrid, removed: RemovedField, *, smallest_mm3: float = CRUMB_MM3
) -> np.ndarray:
    """The voxels of bone without the parts below ``smallest_mm3`` that a drill has cut off.

    ``solid`` is ``(Z, Y, X)`` bool, the bone before the drill.

    Returns
    -------
    ``(Z, Y, X)`` bool, still with the bone that the drill removed.
    """
    left = solid.copy()
    left[removed.slices] &= removed.distance_mm > 0
    parts = components(left)
    small = parts.voxels * grid.voxel_mm3 < smallest_mm3
    if len(small):
        # something is left in any case
        small[np.argmax(parts.voxels)] = False
    return solid & ~parts.chosen(small)
