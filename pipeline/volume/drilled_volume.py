"""A volume and the drill in it: strokes come and go, and the field of what they removed follows.

The field is the least over all capsules (a burr on its way between two points) of their exact distance, and at least
margin less distance for every structure that is spared. Minimum and maximum are exact and take any order: neither the
order of strokes nor what was undone between them leaves a trace, to the last bit. Grey values are never touched.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..surface.mesh import TriangleMesh
from .drill_plan import DrillPlan, Stroke, index_points
from .guards import FAR_MM, TILE, Guards
from .isosurface import Isosurface, RemovedField, block_surface, isosurface
from .volume import Volume, VoxelGrid

BLOCK = 16
"""Cells along the side of a block of the surface."""

_REACH_VOXELS = 2
"""A stroke's field is written so far around it: an edge of the grid that it cuts has both ends there."""

Block = tuple[int, int, int]
"""The place (x, y, z) of a block among blocks; the first begins in the air before the first voxel."""


@dataclass(frozen=True)
class _Capsule:
    """A burr on its way: ``start`` and ``end`` (3,) in index space times spacing, and the box of voxels it changes."""

    radius_mm: float
    start: np.ndarray
    end: np.ndarray
    first: np.ndarray
    stop: np.ndarray


class RemovedSolid:
    """What strokes removed, on the grid of a volume, in a box that grows with them. Mutable on purpose."""

    def __init__(self, grid: VoxelGrid, guards: Guards | None = None) -> None:
        self._grid, self._guards = grid, guards
        self._strokes: list[Stroke] = []
        self._capsules: list[list[_Capsule]] = []
        self._first = self._stop = np.zeros(3, np.int64)
        self._distance = np.empty((0, 0, 0), np.float32)
        self._kept: dict[Block, np.ndarray | None] = {}

    @property
    def strokes(self) -> tuple[Stroke, ...]:
        """The strokes that are not undone."""
        return tuple(self._strokes)

    @property
    def field(self) -> RemovedField:
        """What is removed so far: a view, which later strokes change."""
        return RemovedField(self._first, self._distance)

    def add(self, stroke: Stroke) -> tuple[np.ndarray, np.ndarray]:
        """Remove a stroke; first voxel (x, y, z) that it may have changed, and one past the last."""
        points = index_points(self._grid, stroke.points) * self._grid.spacing_mm
        # the ball at the beginning too, as of a stroke that is still being drawn
        pairs = zip(np.concatenate([points[:1], points[:-1]]), points, strict=True)
        capsules = [self._capsule(stroke.radius_mm, *pair) for pair in pairs]
        self._strokes.append(stroke)
        self._capsules.append(capsules)
        return self._carve(capsules)

    def extend(self, point: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Lead the last stroke on to a point ``(3,)`` in the frame of the mesh; returns as :meth:`add`."""
        stroke = self._strokes[-1]
        self._strokes[-1] = replace(stroke, points=np.concatenate([stroke.points, np.reshape(point, (1, 3))]))
        ends = index_points(self._grid, self._strokes[-1].points[-2:]) * self._grid.spacing_mm
        capsule = self._capsule(stroke.radius_mm, *ends)
        self._capsules[-1].append(capsule)
        return self._carve([capsule])

    def undo(self) -> tuple[np.ndarray, np.ndarray]:
        """Take back the last stroke; returns as :meth:`add`."""
        self._strokes.pop()
        gone = self._capsules.pop()
        first, stop = _around(gone)
        if (stop > first).all():
            self._distance[self._part(first, stop)] = FAR_MM
            for capsule in (capsule for capsules in self._capsules for capsule in capsules):
                self._carve_part(capsule, np.maximum(capsule.first, first), np.minimum(capsule.stop, stop))
        return first, stop

    def _capsule(self, radius_mm: float, start: np.ndarray, end: np.ndarray) -> _Capsule:
        reach = radius_mm + _REACH_VOXELS * self._grid.spacing_mm
        lower, upper = (np.minimum(start, end) - reach) / self._grid.spacing_mm, (np.maximum(start, end) + reach)
        first = np.clip(np.ceil(lower), 0, self._grid.size).astype(np.int64)
        stop = np.clip(np.floor(upper / self._grid.spacing_mm) + 1, 0, self._grid.size).astype(np.int64)
        return _Capsule(radius_mm, start, end, first, stop)

    def _carve(self, capsules: Sequence[_Capsule]) -> tuple[np.ndarray, np.ndarray]:
        first, stop = _around(capsules)
        if (stop > first).all():
            self._grow(first, stop)
            for capsule in capsules:
                self._carve_part(capsule, capsule.first, capsule.stop)
        return first, stop

    def _carve_part(self, capsule: _Capsule, first: np.ndarray, stop: np.ndarray) -> None:
        if (stop <= first).any():
            return
        x, y, z = np.ix_(
            *(
                (np.arange(a, b) * step - at).astype(np.float32)
                for a, b, step, at in zip(first, stop, self._grid.spacing_mm, capsule.start, strict=True)
            )
        )
        x, y, z = x.transpose(2, 1, 0), y.transpose(2, 1, 0), z.transpose(2, 1, 0)
        way = (capsule.end - capsule.start).astype(np.float32)
        squared = way[0] * way[0] + way[1] * way[1] + way[2] * way[2]
        if squared > 0:
            along = x * (way[0] / squared) + y * (way[1] / squared) + z * (way[2] / squared)
            np.clip(along, 0, 1, out=along)
            x, y, z = x - along * way[0], y - along * way[1], z - along * way[2]
        distance = np.sqrt(x * x + y * y + z * z)
        distance -= np.float32(capsule.radius_mm)
        self._spare(distance, first, stop)
        removed = self._distance[self._part(first, stop)]
        np.minimum(removed, distance, out=removed)

    def _spare(self, distance: np.ndarray, first: np.ndarray, stop: np.ndarray) -> None:
        """Keep what the guards keep, in place."""
        if self._guards is None:
            return
        for tile in _boxes(first, stop, TILE):
            if tile not in self._kept:
                self._kept[tile] = self._guards.kept(tile)
            kept = self._kept[tile]
            if kept is None:
                continue
            at = np.array(tile) * TILE
            lower, upper = np.maximum(first, at), np.minimum(stop, at + TILE)
            part = distance[_slices(lower - first, upper - first)]
            np.maximum(part, kept[_slices(lower - at, upper - at)], out=part)

    def _grow(self, first: np.ndarray, stop: np.ndarray) -> None:
        """Make the box large enough, in steps, so that a stroke seldom needs it."""
        if self._distance.size:
            if (first >= self._first).all() and (stop <= self._stop).all():
                return
            first, stop = np.minimum(first, self._first), np.maximum(stop, self._stop)
        first = first // TILE * TILE
        stop = np.minimum(-(-stop // TILE) * TILE, self._grid.size)
        grown = np.full((stop - first)[::-1], FAR_MM)
        if self._distance.size:
            grown[_slices(self._first - first, self._stop - first)] = self._distance
        self._first, self._stop, self._distance = first, stop, grown

    def _part(self, first: np.ndarray, stop: np.ndarray) -> tuple[slice, ...]:
        return _slices(first - self._first, stop - self._first)


class DrilledVolume:
    """A volume, the strokes of a drill in it, and its surface, block by block or whole.

    Parameters
    ----------
    volume
        The CT; never written to.
    level_hu
        Bone lies above it.
    solid
        ``(Z, Y, X)`` bool, as of :func:`.bone_voxels`; all voxels above the level if ``None``.
    guards
        What the drill spares.
    """

    def __init__(
        self, volume: Volume, level_hu: float, solid: np.ndarray | None = None, guards: Guards | None = None
    ) -> None:
        self._volume, self._level, self._solid = volume, level_hu, solid
        self._removed = RemovedSolid(volume.grid, guards)
        self._guards = guards

    @property
    def strokes(self) -> tuple[Stroke, ...]:
        """The strokes that are not undone."""
        return self._removed.strokes

    @property
    def removed(self) -> RemovedField | None:
        """What is removed so far, as a view; ``None`` before the first stroke in the volume."""
        field = self._removed.field
        return field if field.distance_mm.size else None

    def add(self, stroke: Stroke) -> tuple[Block, ...]:
        """Remove a stroke; the blocks whose surface may have changed."""
        return self._touched(*self._removed.add(stroke))

    def extend(self, point: np.ndarray) -> tuple[Block, ...]:
        """Lead the last stroke on to a point ``(3,)`` in the frame of the mesh; the blocks, as :meth:`add`."""
        return self._touched(*self._removed.extend(point))

    def undo(self) -> tuple[Block, ...]:
        """Take back the last stroke; the blocks, as :meth:`add`. Nothing happens if there is none."""
        return self._touched(*self._removed.undo()) if self.strokes else ()

    @property
    def blocks(self) -> tuple[Block, ...]:
        """All blocks of the volume, most of them without a surface."""
        return tuple(_boxes(np.zeros(3, np.int64), np.array(self._volume.grid.size) + 1, BLOCK))

    def block_mesh(self, block: Block) -> Isosurface:
        """The surface in a block; joined, those of all blocks are :meth:`surface`."""
        size = self._volume.grid.size
        first = tuple(BLOCK * at - 1 for at in block)
        stop = tuple(min(at + BLOCK, count) for at, count in zip(first, size, strict=True))
        return block_surface(
            self._volume.values, self._level, self._volume.grid, first, stop,  # type: ignore[arg-type]
            solid=self._solid, removed=self.removed,
        )  # fmt: skip

    def surface(self) -> Isosurface:
        """The whole surface, as extracted."""
        return isosurface(self._volume.values, self._level, self._volume.grid, solid=self._solid, removed=self.removed)

    def nearest_structure(self, point: np.ndarray) -> tuple[str, float] | None:
        """The structure nearest to a point, as :meth:`.Guards.nearest`."""
        return None if self._guards is None else self._guards.nearest(point)

    def stops_at(self, start: np.ndarray, end: np.ndarray, radius_mm: float) -> np.ndarray:
        """How far a burr may go, as :meth:`.Guards.stops_at`."""
        return np.asarray(end, np.float64) if self._guards is None else self._guards.stops_at(start, end, radius_mm)

    @staticmethod
    def _touched(first: np.ndarray, stop: np.ndarray) -> tuple[Block, ...]:
        # a voxel is a corner of the cells on both sides of it, and cells begin one before the voxels
        return tuple(_boxes(first, stop + 1, BLOCK)) if (stop > first).all() else ()


def removed_by_plan(
    plan: DrillPlan, structures: Mapping[str, TriangleMesh], grid: VoxelGrid
) -> tuple[RemovedField, Guards]:
    """The field of a plan, the same as after the same strokes in the window, and what it spared.

    Parameters
    ----------
    structures
        Closed meshes by name, which the plan's margins refer to.

    Raises
    ------
    InputError
        A margin of a structure that is not there.
    """
    guards = Guards(structures, plan.margins_mm, grid)
    solid = RemovedSolid(grid, guards)
    for stroke in plan.strokes:
        solid.add(stroke)
    return solid.field, guards


def _around(capsules: Sequence[_Capsule]) -> tuple[np.ndarray, np.ndarray]:
    inside = [capsule for capsule in capsules if (capsule.stop > capsule.first).all()]
    if not inside:
        return np.zeros(3, np.int64), np.zeros(3, np.int64)
    return np.min([each.first for each in inside], axis=0), np.max([each.stop for each in inside], axis=0)


def _boxes(first: np.ndarray, stop: np.ndarray, side: int) -> Iterator[Block]:
    """The boxes of ``side`` in which voxels from ``first`` to before ``stop`` lie."""
    low, high = first // side, -(-stop // side)
    for z in range(low[2], high[2]):
        for y in range(low[1], high[1]):
            for x in range(low[0], high[0]):
                yield x, y, z


def _slices(first: np.ndarray, stop: np.ndarray) -> tuple[slice, ...]:
    return tuple(slice(int(a), int(b)) for a, b in zip(first[::-1], stop[::-1], strict=True))
