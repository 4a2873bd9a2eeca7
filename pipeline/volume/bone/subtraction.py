"""What others have found to be removed: a predicted or segmented region, or a CT from after the operation.

Both become a field as a drill leaves it, so that the bone that stays keeps its surface.
"""

from collections.abc import Sequence

import numpy as np

from ...errors import InputError
from ..simple_itk import components, grown, resampled
from ..volume import LabelMap, Volume, VoxelGrid, box_around, box_slices
from .bone import CRUMB_MM3
from .isosurface import RemovedField

FAR_MM = 1e3
"""Distance where nothing is removed."""

_SLOPE = 0.5
"""Slope at the border of a mask averaged over a voxel and its neighbours: its share of a voxel per voxel."""

_HU_PER_VOXEL = 1000.0
"""Slope of grey values at the surface of bone; it only weighs this field against others."""

_MARGIN = 3


def removed_by_labels(labels: LabelMap, grid: VoxelGrid) -> RemovedField:
    """The field of the voxels with a label, on the grid of a volume.

    The mask is averaged with the weights 1/4, 1/2, 1/4 along each axis, and the removed part ends where a half is left.
    """
    mask = labels.values > 0
    low, high = box_around(mask)
    share = np.pad(mask[box_slices(low, high)].astype(np.float32), _MARGIN)
    for axis in range(3):
        share = np.moveaxis(share, axis, 0)
        share[1:-1] = share[:-2] / 4 + share[1:-1] / 2 + share[2:] / 4
        share = np.moveaxis(share, 0, axis)
    depth, height, width = share.shape
    own = labels.grid.shifted(low - _MARGIN, (width, height, depth))
    first, stop = grid.box_of(own.corners_mm, "removed part")
    part = grid.shifted(first, tuple(int(count) for count in stop - first))  # type: ignore[arg-type]
    inside = resampled(share, own, part, outside=0.0)
    return RemovedField(first, (np.float32(0.5) - inside) * np.float32(labels.grid.spacing_mm.mean() / _SLOPE))


def removed_by_operation(after: Volume, before: Volume, level_hu: float, solid: np.ndarray) -> RemovedField:
    """The field of the bone that a CT from after the operation no longer shows; it must lie in the same space.

    Differences thinner than two voxels, or below 10 mm³, come from noise and registration, and do not count.

    Bone lies above ``level_hu`` in both; ``solid`` is ``(Z, Y, X)`` bool, the bone before the operation.
    """
    found = resampled(after.values, after.grid, before.grid, outside=np.nan)
    # where the later scan shows nothing, nothing is known to be removed
    hu = np.where(np.isnan(found), 32767, np.rint(found)).astype(np.int16)
    lost = solid & (hu <= level_hu)
    region = grown(grown(lost, -1), 2)
    parts = components(region & lost)
    large = parts.voxels * before.grid.voxel_mm3 >= CRUMB_MM3
    if not large.any():
        raise InputError(
            "operation: expected a CT with less bone than before, found no part of 10 mm³ or more that is missing; "
            "register it to the volume first"
        )
    near = grown(parts.chosen(large), 2)
    first, stop = box_around(near)
    box = box_slices(first, stop)
    per_hu = float(before.grid.spacing_mm.mean()) / _HU_PER_VOXEL
    distance = (hu[box].astype(np.float32) - np.float32(level_hu)) * np.float32(per_hu)
    return RemovedField(first, np.where(near[box], distance, np.float32(FAR_MM)))


def united(fields: Sequence[RemovedField]) -> RemovedField | None:
    """The field of what any of several removed; ``None`` of none."""
    if len(fields) < 2:
        return fields[0] if fields else None
    first = np.min([field.first for field in fields], axis=0)
    stop = np.max([field.first + field.distance_mm.shape[::-1] for field in fields], axis=0)
    distance = np.full((stop - first)[::-1], FAR_MM, np.float32)
    for field in fields:
        at = field.first - first
        part = distance[box_slices(at, at + field.distance_mm.shape[::-1])]
        np.minimum(part, field.distance_mm, out=part)
    return RemovedField(first, distance)
