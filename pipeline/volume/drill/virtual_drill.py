"""A virtual drill in a volume: strokes come and go, and what they removed stands in one field.

Removing the solids of all strokes is the minimum of their signed distances, and keeping the margins of structures the
maximum with how deep a voxel lies in one (constructive solid geometry on implicit functions: Ricci, "A constructive
geometry for computer graphics", 1973). Neither depends on an order: strokes drawn in a window, repeated, taken back,
or read from a file leave the same field to the last bit.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ...surface.mesh import TriangleMesh
from ..bone.isosurface import RemovedField
from ..volume import VoxelGrid, box_slices
from .drill_guard import BLOCK, DrillGuard
from .drill_plan import DrillPlan, Stroke
from .filled import index_points

FAR_MM = np.float32(1e3)
"""Distance where no stroke comes near."""

_REACH_VOXELS = 2.0
"""Around a stroke, where its distances count: both ends of an edge of the grid that it cuts are there."""


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


_NOTHING = VoxelBox(np.zeros(3, np.int64), np.zeros(3, np.int64))


@dataclass(frozen=True)
class _Capsule:
    """A burr on its way; ``start`` and ``end`` (3,) in mm along the axes of the index, and the voxels it may change."""

    radius_mm: float
    start: np.ndarray
    end: np.ndarray
    box: VoxelBox


class DrilledVolume:
    """The strokes so far and the field of what they removed. Mutable: a window changes it with every motion."""

    def __init__(self, grid: VoxelGrid, guard: DrillGuard | None = None) -> None:
        """Begin with nothing removed; ``guard`` holds what no stroke takes away."""
        self._grid, self._guard = grid, guard
        self._strokes: list[Stroke] = []
        self._capsules: list[list[_Capsule]] = []
        self._box = _NOTHING
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
        points = self._along_axes(stroke.points)
        # the ball at its beginning too, as while it is drawn point by point
        starts = np.concatenate([points[:1], points[:-1]])
        capsules = [self._capsule(stroke.radius_mm, *ends) for ends in zip(starts, points, strict=True)]
        self._strokes.append(stroke)
        self._capsules.append(capsules)
        return self._remove(capsules)

    def extend(self, point: np.ndarray) -> VoxelBox:
        """Let the last stroke go on to a point (3,), LPS mm; return the voxels that may have changed."""
        stroke = self._strokes[-1]
        points = np.concatenate([stroke.points, np.reshape(point, (1, 3))])
        self._strokes[-1] = replace(stroke, points=points)
        capsule = self._capsule(stroke.radius_mm, *self._along_axes(points[-2:]))
        self._capsules[-1].append(capsule)
        return self._remove([capsule])

    def undo(self) -> VoxelBox:
        """Take back the last stroke; return the voxels that may have changed."""
        self._strokes.pop()
        changed = _around(self._capsules.pop())
        if not changed.is_empty:
            self._distance_mm[self._slices(changed)] = FAR_MM
            for capsules in self._capsules:
                for capsule in capsules:
                    self._carve(capsule, capsule.box.common(changed))
        return changed

    def _along_axes(self, points: np.ndarray) -> np.ndarray:
        """``(N, 3)`` points in mm along the axes of the index, which are orthogonal, so that distances are the same."""
        return index_points(self._grid, points) * self._grid.spacing_mm

    def _capsule(self, radius_mm: float, start: np.ndarray, end: np.ndarray) -> _Capsule:
        spacing = self._grid.spacing_mm
        reach = radius_mm + _REACH_VOXELS * spacing
        first = np.maximum(np.ceil((np.minimum(start, end) - reach) / spacing), 0).astype(np.int64)
        stop = np.floor((np.maximum(start, end) + reach) / spacing).astype(np.int64) + 1
        return _Capsule(radius_mm, start, end, VoxelBox(first, np.minimum(stop, self._grid.size)))

    def _remove(self, capsules: Sequence[_Capsule]) -> VoxelBox:
        changed = _around(capsules)
        if not changed.is_empty:
            self._grow(changed)
            for capsule in capsules:
                self._carve(capsule, capsule.box)
        return changed

    def _carve(self, capsule: _Capsule, box: VoxelBox) -> None:
        """Remove a capsule within a box; a voxel gets the same number in any box."""
        if box.is_empty:
            return
        distance = _capsule_mm(capsule, box, self._grid.spacing_mm)
        if self._guard is not None:
            self._guard.spare(distance, box.first)
        part = self._distance_mm[self._slices(box)]
        np.minimum(part, distance, out=part)

    def _grow(self, wanted: VoxelBox) -> None:
        """Make room for a box, in whole blocks, so that a burr on its way seldom needs more."""
        box = self._box.united(wanted)
        first = box.first // BLOCK * BLOCK
        stop = np.minimum(-(-box.stop // BLOCK) * BLOCK, self._grid.size)
        if (first == self._box.first).all() and (stop == self._box.stop).all():
            return
        grown = np.full((stop - first)[::-1], FAR_MM, np.float32)
        old, self._box = self._box, VoxelBox(first, stop)
        if not old.is_empty:
            grown[self._slices(old)] = self._distance_mm
        self._distance_mm = grown

    def _slices(self, box: VoxelBox) -> tuple[slice, ...]:
        return box_slices(box.first - self._box.first, box.stop - self._box.first)


def drilled(plan: DrillPlan, grid: VoxelGrid, guard: DrillGuard | None = None) -> DrilledVolume:
    """The volume after all strokes of a plan."""
    volume = DrilledVolume(grid, guard)
    for stroke in plan.strokes:
        volume.add(stroke)
    return volume


def removed_by_plan(plan: DrillPlan, grid: VoxelGrid, structures: Mapping[str, TriangleMesh]) -> RemovedField | None:
    """What a plan removes from a volume with these structures, closed meshes by name; ``None`` without strokes.

    Raises
    ------
    InputError
        A structure is not closed, or there is none for a margin of the plan.
    """
    return drilled(plan, grid, DrillGuard(grid, structures, plan.margins_mm)).removed


def _around(capsules: Sequence[_Capsule]) -> VoxelBox:
    """The box around what they may change."""
    found = _NOTHING
    for capsule in capsules:
        found = found.united(capsule.box)
    return found


def _capsule_mm(capsule: _Capsule, box: VoxelBox, spacing_mm: np.ndarray) -> np.ndarray:
    """``(z, y, x)`` float32 signed distances of voxels to a capsule, negative inside, mm."""
    # from its start, so that single precision is enough far from the origin too
    x, y, z = (
        (np.arange(a, b) * step - at).astype(np.float32)
        for a, b, step, at in zip(box.first, box.stop, spacing_mm, capsule.start, strict=True)
    )
    y, z = y[:, None], z[:, None, None]
    way = (capsule.end - capsule.start).astype(np.float32)
    squared = way[0] * way[0] + way[1] * way[1] + way[2] * way[2]
    if squared > 0:
        part = way / squared
        along = np.clip(x * part[0] + y * part[1] + z * part[2], 0, 1)
        x, y, z = x - along * way[0], y - along * way[1], z - along * way[2]
    distance = np.sqrt(x * x + y * y + z * z)
    distance -= np.float32(capsule.radius_mm)
    return distance
