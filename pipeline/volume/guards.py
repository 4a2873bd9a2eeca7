"""Structures that a drill spares: their distances, and the bone that must stay around them."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from ..errors import InputError
from ..surface.deviation import SurfaceTree
from ..surface.mesh import TriangleMesh
from .inside import inside_mesh
from .volume import VoxelGrid

FAR_MM = np.float32(1e3)
"""Stands for any distance that decides nothing."""

TILE = 16
"""Voxels along the side of the boxes of the grid for which the margins are known or not yet: always the same boxes, so
that the numbers do not depend on what was asked before."""

_CELLS = (4, 2, 1)
"""Voxels along the side of the cells, ever smaller, for which distances are found."""
_EXACT_VOXELS = 1.01
"""Distances are exact so near to where a margin ends; farther away only the sign counts."""

_ON_PATH = 65
"""Points of a path that are looked at together."""


@dataclass(frozen=True)
class _Guard:
    name: str
    margin_mm: float | None
    tree: SurfaceTree
    mesh: TriangleMesh
    first: np.ndarray
    inside: np.ndarray


class Guards:
    """The structures in a volume, and how near a drill may come to them.

    Parameters
    ----------
    structures
        Closed meshes by name, in the frame of the mesh.
    margins_mm
        Least distance of a drill from them, for some or all.
    grid
        Of the volume.

    Raises
    ------
    InputError
        A margin of a structure that is not there, which would protect nothing.
    """

    def __init__(
        self, structures: Mapping[str, TriangleMesh], margins_mm: Mapping[str, float], grid: VoxelGrid
    ) -> None:
        missing = sorted(set(margins_mm) - set(structures))
        if missing:
            known = f"found {', '.join(sorted(structures))}" if structures else "found none"
            raise InputError(
                f"margins: expected the structures {', '.join(missing)} in the label map, {known}; give a map that has "
                "them, or remove their margins"
            )
        self._grid = grid
        # in the order of their names: the numbers must not depend on that of a table
        self._guards = [
            _Guard(name, margins_mm.get(name), SurfaceTree(mesh), mesh, *inside_mesh(mesh, grid))
            for name, mesh in sorted(structures.items())
        ]

    def kept(self, tile: tuple[int, int, int]) -> np.ndarray | None:
        """What must stay in a box of :data:`TILE` voxels a side, with this place (x, y, z) among them.

        Returns
        -------
        ``(z, y, x)`` float32, the greatest of margin less distance over all structures, mm: positive where material
        must stay; ``None`` if nothing must. Exact to one voxel from where it is zero.
        """
        first = np.array(tile) * TILE
        size = np.minimum(first + TILE, self._grid.size) - first
        found: np.ndarray | None = None
        for guard in self._guards:
            if guard.margin_mm is None:
                continue
            own = self._kept_around(guard, guard.margin_mm, first, size)
            if own is not None:
                found = own if found is None else np.maximum(found, own)
        return found

    def _kept_around(self, guard: _Guard, margin_mm: float, first: np.ndarray, size: np.ndarray) -> np.ndarray | None:
        spacing = self._grid.spacing_mm
        # an edge of the grid where the margin ends has both ends so near to it
        band = _EXACT_VOXELS * float(spacing.max())
        inside = _part(guard.first, guard.inside, first, size)
        far = float(np.linalg.norm(spacing * (size - 1))) / 2 + margin_mm + band
        middle = _placed(self._grid, (first + (size - 1) / 2)[None])
        if float(guard.tree.distances(middle, far)[0]) > far and not inside.any():
            return None
        sign = np.where(inside, -1.0, 1.0)
        distance = np.full(inside.shape, np.inf)
        near = np.ones(inside.shape, np.bool_)
        # cells first: within one, the distance changes by no more than its size
        for side in _CELLS:
            slack = float(np.linalg.norm(spacing)) * (side - 1) / 2
            cells = near
            for axis in range(3):
                cells = np.logical_or.reduceat(cells, np.arange(0, cells.shape[axis], side), axis=axis)
            cell = np.nonzero(cells)
            centre = np.stack(cell[::-1], axis=1) * side + (side - 1) / 2 + first
            found = np.full(cells.shape, np.inf)
            found[cell] = guard.tree.distances(_placed(self._grid, centre), margin_mm + band + 2 * slack)
            for axis in range(3):
                found = np.repeat(found, side, axis=axis)
            distance[near] = found[tuple(slice(count) for count in near.shape)][near]
            near &= np.abs(sign * distance - margin_mm) <= band + slack
        kept = np.where(sign * distance < margin_mm, FAR_MM, -FAR_MM)
        kept[near] = (margin_mm - (sign * distance)[near]).astype(np.float32)
        return kept

    def nearest(self, point: np.ndarray) -> tuple[str, float] | None:
        """Name of the structure nearest to a point ``(3,)``, and its distance in mm, negative inside; or ``None``."""
        best: tuple[str, float] | None = None
        order = sorted((self._away_from_box(guard, point), at) for at, guard in enumerate(self._guards))
        for least, at in order:
            if best is not None and least >= best[1]:
                break
            guard = self._guards[at]
            distance = float(self._signed(guard, point[None], np.inf if best is None else abs(best[1]))[0])
            if best is None or distance < best[1]:
                best = guard.name, distance
        return best

    def stops_at(self, start: np.ndarray, end: np.ndarray, radius_mm: float) -> np.ndarray:
        """How far a burr may go on the way from ``start`` to ``end`` before it enters a margin.

        A burr that is in one already may go where it comes no deeper.

        Parameters
        ----------
        start, end
            ``(3,)`` centres of the burr in the frame of the mesh, mm.

        Returns
        -------
        ``(3,)`` the last centre; ``end`` if nothing is in the way.
        """
        start, end = np.asarray(start, np.float64), np.asarray(end, np.float64)
        first, last = 0.0, 1.0
        limit: float | None = None
        # twice: the second time between two neighbours of the first
        for _ in range(2):
            share = np.linspace(first, last, _ON_PATH)
            room = self._room(start + share[:, None] * (end - start), radius_mm)
            limit = min(radius_mm, float(room[0])) if limit is None else limit
            blocked = np.flatnonzero(room < limit - 1e-9)
            if not len(blocked):
                return end if last == 1.0 else start + last * (end - start)
            if blocked[0] == 0:
                break
            first, last = share[blocked[0] - 1], share[blocked[0]]
        return start + first * (end - start)

    def _room(self, points: np.ndarray, most_mm: float) -> np.ndarray:
        """``(N,)`` mm, up to ``most_mm``: the distance of points from the nearest margin, negative in one."""
        room = np.full(len(points), most_mm)
        middle = points.mean(axis=0)
        reach = float(np.linalg.norm(points - middle, axis=1).max())
        for guard in self._guards:
            if guard.margin_mm is None or self._away_from_box(guard, middle) - reach - guard.margin_mm > most_mm:
                continue
            np.minimum(room, self._signed(guard, points, most_mm + guard.margin_mm) - guard.margin_mm, out=room)
        return room

    def _signed(self, guard: _Guard, points: np.ndarray, within_mm: float) -> np.ndarray:
        """``(N,)`` distances, mm, negative inside; where larger than ``within_mm``, only some larger ones."""
        distance, face = guard.tree.nearest(points, within_mm)
        voxel = np.rint(_index(self._grid, points)).astype(np.int64) - guard.first
        within = ((voxel >= 0) & (voxel < guard.inside.shape[::-1])).all(axis=1)
        inside = np.zeros(len(points), np.bool_)
        inside[within] = guard.inside[tuple(voxel[within, ::-1].T)]
        # nearer than a voxel, its centre may lie on the other side
        near = np.flatnonzero(distance < self._grid.spacing_mm.max())
        corner = guard.mesh.vertices[guard.mesh.faces[face[near], 0]]
        inside[near] = np.einsum("nk,nk->n", points[near] - corner, guard.mesh.face_cross[face[near]]) < 0
        return np.where(inside, -distance, distance)

    @staticmethod
    def _away_from_box(guard: _Guard, point: np.ndarray) -> float:
        lower, upper = guard.mesh.bounds
        return float(np.linalg.norm(np.maximum(np.maximum(lower - point, point - upper), 0)))


def _part(first: np.ndarray, mask: np.ndarray, at: np.ndarray, size: np.ndarray) -> np.ndarray:
    """``(z, y, x)`` the part of a mask that begins at voxel ``first`` in a box that begins at ``at``; false outside."""
    found = np.zeros(size[::-1], np.bool_)
    lower = np.maximum(first, at)
    upper = np.minimum(first + mask.shape[::-1], at + size)
    if (upper > lower).all():
        here = tuple(slice(a, b) for a, b in zip((lower - at)[::-1], (upper - at)[::-1], strict=True))
        there = tuple(slice(a, b) for a, b in zip((lower - first)[::-1], (upper - first)[::-1], strict=True))
        found[here] = mask[there]
    return found


def _placed(grid: VoxelGrid, index: np.ndarray) -> np.ndarray:
    """``(N, 3)`` points of index space in the frame of the mesh."""
    return index @ grid.mesh_from_index[:3, :3].T + grid.mesh_from_index[:3, 3]


def _index(grid: VoxelGrid, points: np.ndarray) -> np.ndarray:
    return points @ grid.index_from_mesh[:3, :3].T + grid.index_from_mesh[:3, 3]
