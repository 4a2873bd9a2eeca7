"""What others have found to be removed, a predicted or segmented region, as a field as a drill leaves it: the bone that
stays keeps its surface.
"""

from collections.abc import Sequence

import numpy as np

from ..simple_itk import resampled
from ..volume import LabelMap, VoxelGrid, box_around, box_slices
from .isosurface import RemovedField

FAR_MM = 1e3
"""Distance where nothing is removed."""

_SLOPE = 0.5
"""Slope at the border of a mask averaged over a voxel and its neighbours: its share of a voxel per voxel."""

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
    inside = resampled(share, own, part)
    return RemovedField(first, (np.float32(0.5) - inside) * np.float32(labels.grid.spacing_mm.mean() / _SLOPE))


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
