"""Which voxels of a CT are bone: those above a level of HU, without islands and tiny holes."""

import numpy as np

from ...errors import InputError
from ..simple_itk import components
from ..volume import Volume, VoxelGrid
from .isosurface import RemovedField

DEFAULT_HU = 300.0
"""Above soft tissue and below cortical bone."""

LOWEST_HU, HIGHEST_HU = 200.0, 700.0
"""Range of :func:`otsu_threshold`."""

_AIR_HU = -200
"""Up to here voxels do not count: the largest step in a CT of a head is that from air to skin."""

_PART = 1 << 21
"""Voxels that are counted at a time, which bounds the memory that it takes."""

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


def otsu_threshold(volume: Volume) -> float:
    """The threshold by Otsu (1979) of all voxels above -200 HU, kept within 200 to 700 HU.

    Returns
    -------
    The HU that separates soft tissue from bone: the largest value below it and the smallest above it belong to
    different classes.
    """
    counts = histogram(volume.values)[_AIR_HU + 2**15 + 1 :].astype(np.float64)
    hu = np.arange(_AIR_HU + 1, 2**15, dtype=np.float64)
    if not counts.any():
        raise InputError(
            f"threshold: expected tissue and bone, found no voxel above {_AIR_HU} HU; choose another volume"
        )
    below = np.cumsum(counts)
    above = below[-1] - below
    sum_below = np.cumsum(counts * hu)
    with np.errstate(divide="ignore", invalid="ignore"):
        between = below * above * (sum_below / below - (sum_below[-1] - sum_below) / above) ** 2
    # equal along a gap in the histogram: its middle is farthest from both classes
    best = np.flatnonzero(between == np.nanmax(np.where(above > 0, between, -1.0)))
    threshold = (hu[best[0]] + hu[best[-1]]) / 2 + 0.5
    return float(np.clip(threshold, LOWEST_HU, HIGHEST_HU))


def histogram(values: np.ndarray) -> np.ndarray:
    """``(65536,)`` number of voxels of each HU from -32768, of a ``(Z, Y, X)`` int16 array, in little memory."""
    counts = np.zeros(1 << 16, np.int64)
    rows = max(_PART // max(values[0].size, 1), 1)
    for first in range(0, len(values), rows):
        part = values[first : first + rows].astype(np.int32).ravel() + 2**15
        counts += np.bincount(part, minlength=1 << 16)
    return counts


def check_threshold(volume: Volume, level_hu: float) -> None:
    """Check that a threshold has voxels on both sides."""
    lowest, highest = int(volume.values.min()), int(volume.values.max())
    if not lowest < level_hu < highest:
        raise InputError(
            f"threshold: expected a level between the volume's {lowest} and {highest} HU, found {level_hu:g}; bone is "
            f"usually above {DEFAULT_HU:g} HU"
        )
