"""Where a ray meets the bone of a volume, drilled or not: what a pointer points at, without a mesh."""

import numpy as np

from ...transforms import transform_points
from ..bone.isosurface import RemovedField
from ..volume import Sampler, Volume

STEP_VOXELS = 0.5
_FINE = 12
"""Samples between the last step in air and the first in bone."""


def first_bone(
    volume: Volume,
    level_hu: float,
    solid: np.ndarray,
    removed: RemovedField | None,
    origin_mm: np.ndarray,
    direction: np.ndarray,
) -> np.ndarray | None:
    """The point ``(3,)`` where a ray enters bone, LPS mm; ``None`` if it misses.

    Parameters
    ----------
    level_hu, solid
        Bone lies above the level, in ``(Z, Y, X)`` bool.
    removed
        What was drilled away.
    origin_mm, direction
        ``(3,)`` of the ray in LPS; the direction has any length.
    """
    grid = volume.grid
    direction = np.asarray(direction, np.float64) / np.linalg.norm(direction)
    start = transform_points(grid.index_from_mesh, np.asarray(origin_mm, np.float64)[None])[0]
    step = grid.index_from_mesh[:3, :3] @ direction
    with np.errstate(divide="ignore", invalid="ignore"):
        ends = np.stack([(-0.5 - start) / step, (np.array(grid.size) - 0.5 - start) / step])
    outside = (step == 0) & ((start < -0.5) | (start > np.array(grid.size) - 0.5))
    ends = np.where(step == 0, np.array([[-np.inf], [np.inf]]), ends)
    near, far = max(float(ends.min(axis=0).max()), 0.0), float(ends.max(axis=0).min())
    if outside.any() or not near < far:
        return None
    stride = STEP_VOXELS * float(grid.spacing_mm.min())
    along = np.arange(near, far, stride)
    voxels = np.clip(np.rint(start + along[:, None] * step).astype(np.intp), 0, np.array(grid.size) - 1)
    inside = solid[voxels[:, 2], voxels[:, 1], voxels[:, 0]]
    if removed is not None:
        place = voxels - removed.first
        within = np.flatnonzero(inside & ((place >= 0) & (place < removed.distance_mm.shape[::-1])).all(axis=1))
        x, y, z = place[within].T
        inside[within] = removed.distance_mm[z, y, x] > 0
    hits = np.flatnonzero(inside)
    if len(hits) == 0:
        return None
    first = float(along[hits[0]])
    fine = np.linspace(max(first - 1.5 * stride, near), first, _FINE)
    points = np.asarray(origin_mm, np.float64) + fine[:, None] * direction
    bone = Sampler(grid, points).values(volume.values, outside=level_hu - 1) > level_hu
    if removed is not None:
        bone &= removed.sampled(grid, points, outside=1.0) > 0
    bone[-1] = True
    return points[int(np.argmax(bone))]
