"""What a drill must spare: the structures, and a margin of bone around each."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from ..surface.deviation import SurfaceTree
from ..surface.mesh import TriangleMesh
from ..transforms import transform_points
from .filled import filled
from .volume import VoxelGrid

BLOCK = 16
"""Voxels along an axis of the blocks in which distances are computed, once and when they are asked for."""

FREE_MM = np.float32(-1e3)
"""How far a voxel lies within a margin, where it lies far outside."""

_BAND_VOXELS = 2.0
"""Around a margin: the end of the bone lies between two voxels, and both need their distance."""


KEPT_MM = np.float32(1e3)
"""How deep a voxel lies within a margin, where it lies deep in a structure."""


@dataclass(frozen=True)
class _Structure:
    """A structure; ``inside`` and ``near`` (z, y, x) bool, from voxel ``first`` on: within, and near its surface."""

    name: str
    margin_mm: float
    tree: SurfaceTree
    bounds_mm: np.ndarray
    first: np.ndarray
    inside: np.ndarray
    near: np.ndarray


class DrillGuard:
    """Distances to structures on the grid of a volume. It only grows: a block that was computed is kept."""

    def __init__(
        self, grid: VoxelGrid, structures: Mapping[str, TriangleMesh], margins_mm: Mapping[str, float]
    ) -> None:
        """Prepare closed meshes (LPS, mm) by name; a structure without a margin keeps its own volume only.

        Raises
        ------
        InputError
            A mesh is not closed.
        """
        self._grid = grid
        self._band_mm = _BAND_VOXELS * float(grid.spacing_mm.max())
        self._structures = [
            self._structure(name, mesh, float(margins_mm.get(name, 0.0))) for name, mesh in structures.items()
        ]
        self._blocks: dict[tuple[int, ...], np.ndarray | None] = {}

    @property
    def names(self) -> tuple[str, ...]:
        """The structures."""
        return tuple(structure.name for structure in self._structures)

    def within_mm(self, first: np.ndarray, stop: np.ndarray) -> np.ndarray:
        """How deep voxels lie in the margin of a structure, mm, negative outside: bone stays where it is positive.

        Parameters
        ----------
        first, stop
            First voxel (x, y, z) of a box and one past its last.

        Returns
        -------
        ``(z, y, x)`` float32; :data:`FREE_MM` far from all margins.
        """
        found = np.full((stop - first)[::-1], FREE_MM, np.float32)
        lowest, highest = first // BLOCK, (stop - 1) // BLOCK
        for z in range(lowest[2], highest[2] + 1):
            for y in range(lowest[1], highest[1] + 1):
                for x in range(lowest[0], highest[0] + 1):
                    block = self._block((x, y, z))
                    if block is None:
                        continue
                    at = np.array([x, y, z]) * BLOCK
                    low, high = np.maximum(at, first), np.minimum(at + BLOCK, stop)
                    target = tuple(slice(a, b) for a, b in zip((low - first)[::-1], (high - first)[::-1], strict=True))
                    part = tuple(slice(a, b) for a, b in zip((low - at)[::-1], (high - at)[::-1], strict=True))
                    found[target] = block[part]
        return found

    def nearest(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Distances of points ``(N, 3)``, LPS mm, from the surface of the nearest structure, and its number ``(N,)``.

        Infinite, and -1, without structures.
        """
        distance, number = np.full(len(points), np.inf), np.full(len(points), -1)
        for index, structure in enumerate(self._structures):
            found = structure.tree.distances(points)
            number[found < distance] = index
            np.minimum(distance, found, out=distance)
        return distance, number

    def room_mm(self, point: np.ndarray, radius_mm: float) -> float:
        """How far a burr at a point (3,), LPS mm, is from the nearest margin, mm; negative within one."""
        room = np.inf
        for structure in self._structures:
            gap = np.maximum(structure.bounds_mm[0] - point, point - structure.bounds_mm[1])
            # not nearer than its box
            least = float(np.linalg.norm(np.maximum(gap, 0))) - radius_mm - structure.margin_mm
            if least < room:
                distance = float(structure.tree.distances(point[None])[0])
                if self._is_inside(structure, point):
                    distance = -distance
                room = min(room, distance - radius_mm - structure.margin_mm)
        return room

    def reached(self, start: np.ndarray, end: np.ndarray, radius_mm: float) -> np.ndarray:
        """The point (3,) up to which a burr may go from ``start`` towards ``end`` before it meets a margin.

        ``start`` itself if the burr is in one there already and would not leave it.
        """
        path = end - start
        length = float(np.linalg.norm(path))
        if length == 0:
            return start
        least = 0.01 * float(self._grid.spacing_mm.min())
        travelled = 0.0
        while travelled < length:
            # as far as the room is, no margin can be met (sphere tracing: Hart 1996)
            room = self.room_mm(start + path * (travelled / length), radius_mm)
            if room < least:
                break
            travelled = min(travelled + room, length)
        return start + path * (travelled / length)

    def _structure(self, name: str, mesh: TriangleMesh, margin_mm: float) -> _Structure:
        around = np.ceil((margin_mm + self._band_mm) / self._grid.spacing_mm).astype(int) + 1
        start, mask = filled(mesh, self._grid)
        index = transform_points(self._grid.index_from_mesh, mesh.vertices)
        first = np.maximum(np.floor(index.min(axis=0)).astype(int) - around, 0)
        stop = np.minimum(np.ceil(index.max(axis=0)).astype(int) + around + 1, self._grid.size)
        inside = np.zeros(np.maximum(stop - first, 0)[::-1], np.bool_)
        if mask.size:
            low = start - first
            inside[tuple(slice(a, a + n) for a, n in zip(low[::-1], mask.shape, strict=True))] = mask
        surface = np.zeros_like(inside)
        for axis in range(3):
            ends = np.diff(inside, axis=axis)
            for part in (slice(None, -1), slice(1, None)):
                surface[(slice(None),) * axis + (part,)] |= ends
        # thin parts may lie between the voxels
        place = np.rint(index).astype(int) - first
        place = place[((place >= 0) & (place < inside.shape[::-1])).all(axis=1)]
        surface[tuple(place[:, ::-1].T)] = True
        return _Structure(
            name, margin_mm, SurfaceTree(mesh), mesh.bounds, first, inside, _dilated(surface, around[::-1])
        )

    def _is_inside(self, structure: _Structure, point: np.ndarray) -> bool:
        matrix = self._grid.index_from_mesh
        index = np.rint(matrix[:3, :3] @ point + matrix[:3, 3]).astype(int) - structure.first
        if (index < 0).any() or (index >= structure.inside.shape[::-1]).any():
            return False
        return bool(structure.inside[tuple(index[::-1])])

    def _block(self, key: tuple[int, int, int]) -> np.ndarray | None:
        if key not in self._blocks:
            self._blocks[key] = self._computed(np.array(key) * BLOCK)
        return self._blocks[key]

    def _computed(self, first: np.ndarray) -> np.ndarray | None:
        """``(16, 16, 16)`` float32 of a block of voxels; ``None`` if all of them are free."""
        deepest: np.ndarray | None = None
        for structure in self._structures:
            low = np.maximum(first, structure.first)
            high = np.minimum(first + BLOCK, structure.first + structure.near.shape[::-1])
            if (high <= low).any():
                continue
            part = tuple(
                slice(a, b) for a, b in zip((low - structure.first)[::-1], (high - structure.first)[::-1], strict=True)
            )
            inside, near = structure.inside[part], structure.near[part]
            if not (inside.any() or near.any()):
                continue
            depth = np.where(inside, KEPT_MM, FREE_MM)
            distance = structure.tree.distances(voxel_points(self._grid, low, high)[near])
            depth[near] = structure.margin_mm - np.where(inside[near], -distance, distance)
            if deepest is None:
                deepest = np.full((BLOCK,) * 3, FREE_MM, np.float32)
            target = tuple(slice(a, b) for a, b in zip((low - first)[::-1], (high - first)[::-1], strict=True))
            np.maximum(deepest[target], depth, out=deepest[target])
        return deepest


def _dilated(mask: np.ndarray, steps: np.ndarray) -> np.ndarray:
    """A mask grown by a box that reaches so many voxels along each axis, both ways."""
    for axis, reach in enumerate(steps):
        moved = np.moveaxis(mask, axis, 0)
        total = np.concatenate([np.zeros((1, *moved.shape[1:]), np.int32), np.cumsum(moved, axis=0, dtype=np.int32)])
        places = np.arange(len(moved))
        high, low = np.minimum(places + reach + 1, len(moved)), np.maximum(places - reach, 0)
        mask = np.moveaxis(total[high] > total[low], 0, axis)
    return mask


def voxel_points(grid: VoxelGrid, first: np.ndarray, stop: np.ndarray) -> np.ndarray:
    """``(z, y, x, 3)`` centres of a box of voxels, LPS mm; each is the same to the last bit in any box."""
    x, y, z = (np.arange(a, b, dtype=np.float64) for a, b in zip(first, stop, strict=True))
    points = np.empty((len(z), len(y), len(x), 3))
    for row in range(3):
        m = grid.mesh_from_index[row]
        # not by a matrix product, whose last bits depend on the number of points
        points[..., row] = (z * m[2] + m[3])[:, None, None] + (y * m[1])[:, None] + x * m[0]
    return points
