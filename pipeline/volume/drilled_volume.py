"""A virtual drill in a volume: strokes come and go, and what they removed stands in one field.

Removing the solids of all strokes is the minimum of their signed distances, and keeping the margins of structures the
maximum with how deep a voxel lies in one (constructive solid geometry on implicit functions: Ricci, "A constructive
geometry for computer graphics", 1973). Neither depends on an order: strokes drawn in a window, repeated, taken back,
or read from a file leave the same field to the last bit.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from .drill_guard import BLOCK, DrillGuard, voxel_points
from .drill_plan import DrillPlan, Stroke
from .isosurface import RemovedField
from .volume import VoxelGrid

FAR_MM = np.float32(1e3)
"""Distance where no stroke comes near."""

_REACH_VOXELS = 2.0
"""Around a stroke, where its distances count."""


@dataclass(frozen=True)
class VoxelBox:
    """First voxel ``(3,)`` (x, y, z) of a box, and one past its last."""

    first: np.ndarray
    stop: np.ndarray

    @property
    def is_empty(self) -> bool:
        """Whether it holds no voxel."""
        return bool((self.stop <= self.first).any())

    def united(self, other: "VoxelBox") -> "VoxelBox":
        """The box around both."""
        if self.is_empty or other.is_empty:
            return other if self.is_empty else self
        return VoxelBox(np.minimum(self.first, other.first), np.maximum(self.stop, other.stop))

    def common(self, other: "VoxelBox") -> "VoxelBox":
        """The voxels in both."""
        return VoxelBox(np.maximum(self.first, other.first), np.minimum(self.stop, other.stop))


class DrilledVolume:
    """The strokes so far and the field of what they removed. Mutable: a window changes it with every motion."""

    def __init__(self, grid: VoxelGrid, guard: DrillGuard | None = None) -> None:
        """Begin with nothing removed; ``guard`` holds what no stroke takes away."""
        self._grid, self._guard = grid, guard
        self._strokes: list[Stroke] = []
        self._box = VoxelBox(np.zeros(3, int), np.zeros(3, int))
        self._distance_mm = np.zeros((0, 0, 0), np.float32)

    @property
    def strokes(self) -> tuple[Stroke, ...]:
        """In the order in which they were drawn."""
        return tuple(self._strokes)

    @property
    def removed(self) -> RemovedField | None:
        """What the strokes removed, ``None`` if there are none; later strokes may change its array."""
        return RemovedField(self._box.first, self._distance_mm) if self._strokes else None

    def add(self, stroke: Stroke) -> VoxelBox:
        """Add a whole stroke; return the voxels that may have changed."""
        self._strokes.append(stroke)
        boxes = [self._voxels(stroke.radius_mm, part) for part in _parts(stroke.points)]
        changed = boxes[0]
        for box in boxes[1:]:
            changed = changed.united(box)
        self._grow(changed)
        for box, part in zip(boxes, _parts(stroke.points), strict=True):
            self._remove(stroke.radius_mm, part, box)
        return changed

    def extend(self, point: np.ndarray) -> VoxelBox:
        """Let the last stroke go on to a point (3,), LPS mm; return the voxels that may have changed."""
        stroke = self._strokes[-1]
        segment = np.stack([stroke.points[-1], point])
        self._strokes[-1] = replace(stroke, points=np.concatenate([stroke.points, point[None]]))
        box = self._voxels(stroke.radius_mm, segment)
        self._grow(box)
        self._remove(stroke.radius_mm, segment, box)
        return box

    def undo(self) -> VoxelBox:
        """Take back the last stroke; return the voxels that may have changed."""
        last = self._strokes.pop()
        changed = VoxelBox(np.zeros(3, int), np.zeros(3, int))
        for part in _parts(last.points):
            changed = changed.united(self._voxels(last.radius_mm, part))
        if not changed.is_empty:
            self._distance_mm[self._slices(changed)] = FAR_MM
            for stroke in self._strokes:
                for part in _parts(stroke.points):
                    self._remove(stroke.radius_mm, part, self._voxels(stroke.radius_mm, part).common(changed))
        return changed

    def _voxels(self, radius_mm: float, points: np.ndarray) -> VoxelBox:
        """The voxels near a ball or a capsule."""
        reach = radius_mm + _REACH_VOXELS * float(self._grid.spacing_mm.max())
        matrix = self._grid.index_from_mesh
        index = points @ matrix[:3, :3].T + matrix[:3, 3]
        # of a ball, along each axis of the index
        extent = reach * np.linalg.norm(matrix[:3, :3], axis=1)
        first = np.maximum(np.floor(index.min(axis=0) - extent), 0).astype(int)
        stop = np.minimum(np.ceil(index.max(axis=0) + extent) + 1, self._grid.size).astype(int)
        return VoxelBox(first, np.maximum(stop, first))

    def _grow(self, wanted: VoxelBox) -> None:
        """Make room for a box, in whole blocks."""
        if wanted.is_empty:
            return
        if (
            not self._box.is_empty
            and self._box.united(wanted).common(self._box).first.tolist() == (self._box.united(wanted).first.tolist())
            and (wanted.stop <= self._box.stop).all()
        ):
            return
        box = self._box.united(wanted)
        first = box.first // BLOCK * BLOCK
        stop = np.minimum(-(-box.stop // BLOCK) * BLOCK, self._grid.size)
        grown = np.full((stop - first)[::-1], FAR_MM, np.float32)
        old, self._box = self._box, VoxelBox(first, stop)
        if not old.is_empty:
            grown[self._slices(old)] = self._distance_mm
        self._distance_mm = grown

    def _slices(self, box: VoxelBox) -> tuple[slice, ...]:
        low, high = box.first - self._box.first, box.stop - self._box.first
        return tuple(slice(a, b) for a, b in zip(low[::-1], high[::-1], strict=True))

    def _remove(self, radius_mm: float, points: np.ndarray, box: VoxelBox) -> None:
        """Remove a ball or a capsule within a box."""
        if box.is_empty:
            return
        distance = _capsule_mm(voxel_points(self._grid, box.first, box.stop), points, radius_mm).astype(np.float32)
        if self._guard is not None:
            np.maximum(distance, self._guard.within_mm(box.first, box.stop), out=distance)
        part = self._distance_mm[self._slices(box)]
        np.minimum(part, distance, out=part)


def drilled(plan: DrillPlan, grid: VoxelGrid, guard: DrillGuard | None = None) -> DrilledVolume:
    """The volume after all strokes of a plan."""
    volume = DrilledVolume(grid, guard)
    for stroke in plan.strokes:
        volume.add(stroke)
    return volume


def _parts(points: np.ndarray) -> Sequence[np.ndarray]:
    """The ball at the first point of a stroke, and its segments, whether it is drawn point by point or at once."""
    return [points[:1], *(points[at : at + 2] for at in range(len(points) - 1))]


def _capsule_mm(places: np.ndarray, points: np.ndarray, radius_mm: float) -> np.ndarray:
    """Signed distances of places ``(..., 3)`` to a ball or a capsule about one or two points, negative inside; mm."""
    offset = [places[..., axis] - points[0, axis] for axis in range(3)]
    path = points[-1] - points[0]
    squared = float((path * path).sum())
    if squared > 0:
        along = np.clip(sum(o * p for o, p in zip(offset, path, strict=True)) / squared, 0, 1)
        offset = [o - along * p for o, p in zip(offset, path, strict=True)]
    return np.sqrt(offset[0] * offset[0] + offset[1] * offset[1] + offset[2] * offset[2]) - radius_mm
