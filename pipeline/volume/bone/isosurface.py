"""The surface where a volume crosses a level: marching cubes with shared vertices, in slabs of bounded memory.

A vertex lies where an edge of the grid, between two neighbouring voxels, leaves the material, at the linear
interpolation of their values; the triangles between them are those of :mod:`.cell_table`. Around the
volume lies air, so every surface is closed. A drill is a second field, and a vertex lies at whichever of the two
crossings is nearer to the material: the bone's own surface keeps its vertices, bit by bit, and the drilled one is as
exact as the drill's distances, whatever the grey values.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np

from ...surface.mesh import TriangleMesh
from ..volume import Sampler, VoxelGrid, box_slices
from .cell_table import EDGES, cell_table

NEAREST_TO_VOXEL = 1 / 1024
"""Least distance of a vertex from the voxels of its edge, in edges: no triangle shrinks to a point, not even when it
is written in single precision."""

_FAR_MM = 1e9

_CORNERS = np.array([[corner & 1, corner >> 1 & 1, corner >> 2 & 1] for corner in range(8)])
_OWN_EDGES = np.array([[(case ^ case >> (1 << axis)) & 1 for axis in range(3)] for case in range(256)], np.bool_)
"""``(256, 3)``: which of the edges along x, y and z from a cell's first corner leave the material."""
_OWN_COUNT = _OWN_EDGES.sum(axis=1)
_OWN_RANK: np.ndarray = (np.cumsum(_OWN_EDGES, axis=1) - _OWN_EDGES).astype(np.uint8)


@dataclass(frozen=True)
class RemovedField:
    """What a drill removed, in a box of the volume; outside the box nothing is removed.

    Attributes
    ----------
    first
        ``(3,)`` the box's first voxel (x, y, z) in the volume.
    distance_mm
        ``(z, y, x)`` float32 signed distance to the removed solid near its surface: positive where bone stays.
    """

    first: np.ndarray
    distance_mm: np.ndarray

    @property
    def slices(self) -> tuple[slice, ...]:
        """The box in an array of the volume."""
        return box_slices(self.first, self.first + self.distance_mm.shape[::-1])

    def sampled(
        self, grid: VoxelGrid, points: np.ndarray, *, outside: float, farthest_mm: float = np.inf
    ) -> np.ndarray:
        """``(N,)`` float32 distances at points ``(N, 3)``, LPS mm, and another number ``outside`` the box.

        ``grid`` is that of the volume; distances beyond ``farthest_mm`` count as that.
        """
        depth, height, width = self.distance_mm.shape
        box = Sampler(grid.shifted(self.first, (width, height, depth)), points)
        return box.values(self.distance_mm, outside=outside, of=partial(np.clip, a_min=-farthest_mm, a_max=farthest_mm))


@dataclass(frozen=True)
class Isosurface:
    """A surface; closed unless it is that of a block.

    Attributes
    ----------
    mesh
        In the frame of the mesh (LPS), mm; fronts towards air.
    drilled
        ``(V,)`` bool: the vertices that the drill made, not the bone's own surface.
    """

    mesh: TriangleMesh
    drilled: np.ndarray


def isosurface(
    values: np.ndarray,
    level: float,
    grid: VoxelGrid,
    *,
    solid: np.ndarray | None = None,
    removed: RemovedField | None = None,
    slab: int = 64,
    progress: Callable[[float], None] | None = None,
) -> Isosurface:
    """The closed surface of the material, half a voxel outside the volume where material touches its border.

    Parameters
    ----------
    values
        ``(Z, Y, X)`` finite numbers; material lies above ``level``. In a volume of integers a whole ``level`` counts as
        half of one more, so that no voxel lies on it.
    solid
        ``(Z, Y, X)`` bool: the voxels of material, where they are not all those above the level, such as those of one
        component, its holes filled. Between two voxels whose values do not tell where the material ends, it ends
        halfway.
    removed
        What a drill removed from them.
    slab
        Number of layers that are in memory at a time; the surface is the same for any.
    progress
        Called with the finished share, 0..1, after each slab; what it raises ends the work.
    """
    material = _Material(values, level, solid, removed)
    depth, height, width = values.shape
    vertices, drilled, faces = [], [], []
    count = 0
    for start in range(-1, depth, slab):
        stop = min(start + slab, depth)
        # one layer more: its vertices are the next slab's, but this slab's faces use them
        inside = material.inside((start, -1, -1), (stop + 2, height + 2, width + 2))
        piece = _triangulated(inside)
        own = int(np.searchsorted(piece.lower[:, 0], stop - start))
        points, made = material.crossings(piece, (start, -1, -1), own)
        vertices.append(points)
        drilled.append(made)
        faces.append(piece.faces + np.int32(count))
        count += own
        if progress is not None:
            progress((stop + 1) / (depth + 1))
    return _placed(np.concatenate(vertices), np.concatenate(drilled), np.concatenate(faces), grid)


def block_surface(
    values: np.ndarray,
    level: float,
    grid: VoxelGrid,
    first: tuple[int, int, int],
    stop: tuple[int, int, int],
    *,
    solid: np.ndarray | None = None,
    removed: RemovedField | None = None,
) -> Isosurface:
    """The part of :func:`isosurface` in a block of cells; the cost depends on the block alone.

    The cell ``(x, y, z)`` has that voxel as its first corner; cells begin at -1, in the air around the volume.
    Neighbouring blocks have equal vertices on the face between them.

    ``first`` is the first cell of the block and ``stop`` one past its last, as (x, y, z); the rest is as there.
    """
    material = _Material(values, level, solid, removed)
    lower, upper = first[::-1], stop[::-1]
    inner = material.inside(lower, tuple(each + 1 for each in upper))
    inside = np.empty([count + 1 for count in inner.shape], np.uint8)
    # repeated at the end, where the block has no edges of its own
    inside[:-1, :-1, :-1] = inner
    inside[-1], inside[:, -1], inside[:, :, -1] = inside[-2], inside[:, -2], inside[:, :, -2]
    piece = _triangulated(inside)
    points, made = material.crossings(piece, lower, len(piece.lower))
    return _placed(points, made, piece.faces, grid)


@dataclass(frozen=True)
class _Piece:
    """Faces of a block of cells, and the edges of the grid on which their vertices lie.

    ``lower`` (V, 3) is each edge's first voxel (z, y, x) in the block, in C order; ``axis`` (V,) its direction, 0 for
    x; ``leaving`` (V,) bool: the first voxel is the one in material.
    """

    lower: np.ndarray
    axis: np.ndarray
    leaving: np.ndarray
    faces: np.ndarray


def _triangulated(inside: np.ndarray) -> _Piece:
    """Triangles of a block of cells, from ``(nz + 2, ny + 2, nx + 2)`` uint8, 1 in material, for nz * ny * nx cells.

    The last layer on each axis only tells which edges begin at the last but one.
    """
    case = inside[:, :, :-1] | inside[:, :, 1:] << 1
    case = case[:, :-1] | case[:, 1:] << 2
    case = case[:-1] | case[1:] << 4
    shape = case.shape
    case = case.ravel()
    # neither 0 nor 255
    cell = np.flatnonzero(case + np.uint8(1) > 1)
    kind = case[cell]

    # vertices, numbered by the first voxel of their edge, and by its axis
    own = _OWN_COUNT[kind]
    number = np.empty(len(case), np.int32)
    number[cell] = np.cumsum(own) - own
    place, axis = np.nonzero(_OWN_EDGES[kind])
    lower = np.stack(np.unravel_index(cell[place], shape), axis=1)
    leaving = (kind[place] & 1).astype(np.bool_)

    # faces
    for axis_of, count in enumerate(shape):
        stride = int(np.prod(shape[axis_of + 1 :]))
        keep = cell < (count - 1) * stride if axis_of == 0 else cell // stride % count < count - 1
        cell, kind = cell[keep], kind[keep]
    table = cell_table()
    triangles = table.count[kind]
    end = np.cumsum(triangles)
    row = np.arange(end[-1] if len(end) else 0) + np.repeat(table.first[kind] - end + triangles, triangles)
    base = np.repeat(cell, triangles)
    strides = np.array([1, shape[2], shape[1] * shape[2]])
    owner = np.array([_CORNERS[corner] @ strides for _, corner in EDGES])
    along = np.array([axis for axis, _ in EDGES])
    faces = np.empty((len(row), 3), np.int32)
    for corner in range(3):
        edge = table.triangles[row, corner]
        first = base + owner[edge]
        faces[:, corner] = number[first] + _OWN_RANK[case[first], along[edge]]
    return _Piece(lower, axis, leaving, faces)


class _Material:
    """Where material lies, and where it ends between two voxels."""

    def __init__(
        self, values: np.ndarray, level: float, solid: np.ndarray | None, removed: RemovedField | None
    ) -> None:
        if values.dtype == np.bool_:
            values = values.view(np.uint8)
        self._values, self._solid, self._removed = values, solid, removed
        self._whole = np.issubdtype(values.dtype, np.integer)
        if self._whole:
            level = level + 0.5 if float(level).is_integer() else level
        else:
            level = float(values.dtype.type(level))
        self._level = level

    def inside(self, first: tuple[int, ...], stop: tuple[int, ...]) -> np.ndarray:
        """``(z, y, x)`` uint8, 1 in material, of a box of voxels from index ``first`` to before ``stop``, (z, y, x).

        The box may reach beyond the volume.
        """
        found = np.zeros([b - a for a, b in zip(first, stop, strict=True)], np.uint8)
        volume, box = _overlap(first, stop, (0, 0, 0), self._values.shape)
        if self._solid is not None:
            found[box] = self._solid[volume]
        elif self._whole:
            found[box] = self._values[volume] > int(np.floor(self._level))
        else:
            found[box] = self._values[volume] > self._level
        if self._removed is not None:
            distance = self._removed.distance_mm
            drill, box = _overlap(first, stop, tuple(int(at) for at in self._removed.first[::-1]), distance.shape)
            found[box] &= distance[drill] > 0
        return found

    def crossings(self, piece: _Piece, first: tuple[int, ...], count: int) -> tuple[np.ndarray, np.ndarray]:
        """Where the first ``count`` edges of a piece that begins at voxel ``first`` (z, y, x) leave the material.

        Returns
        -------
        ``(count, 3)`` points (x, y, z) in index space, and ``(count,)`` bool: those that the drill made.
        """
        axis, leaving = piece.axis[:count], piece.leaving[:count]
        lower = piece.lower[:count] + np.array(first)
        upper = lower.copy()
        upper[np.arange(count), 2 - axis] += 1
        material = np.where(leaving[:, None], lower, upper)
        air = np.where(leaving[:, None], upper, lower)

        outside = ((air < 0) | (air >= self._values.shape)).any(axis=1)
        nearest = tuple(np.clip(air, 0, np.array(self._values.shape) - 1).T)
        above = self._values[tuple(material.T)] - np.float64(self._level)
        below = self._values[nearest] - np.float64(self._level)
        share = np.full(count, 0.5)
        np.divide(above, above - below, out=share, where=(above > 0) & (below <= 0) & ~outside)
        drilled = np.zeros(count, np.bool_)
        if self._removed is not None:
            self._drill(self._removed, share, drilled, material, air, ~outside)
        np.clip(share, NEAREST_TO_VOXEL, 1 - NEAREST_TO_VOXEL, out=share)

        points = lower[:, ::-1].astype(np.float64)
        points[np.arange(count), axis] += np.where(leaving, share, 1 - share)
        return points, drilled

    def _drill(
        self,
        removed: RemovedField,
        share: np.ndarray,
        drilled: np.ndarray,
        material: np.ndarray,
        air: np.ndarray,
        is_voxel: np.ndarray,
    ) -> None:
        """Move crossings, ``share`` (N,) of the way from ``material`` to ``air``, to where the drill came nearer."""
        kept = _distance(removed, air)
        at = np.flatnonzero(kept <= 0)
        rest = _distance(removed, material[at])
        cut = rest / (rest - kept[at])
        # the air may have been material before
        was_material = is_voxel[at]
        was_material[was_material] = self._is_material(tuple(air[at][was_material].T))
        nearer = was_material | (cut < share[at])
        share[at[nearer]] = cut[nearer]
        drilled[at[nearer]] = True

    def _is_material(self, voxels: tuple[np.ndarray, ...]) -> np.ndarray:
        """``(N,)`` bool: whether voxels, given by their indices z, y and x, were material before the drill."""
        return self._values[voxels] > self._level if self._solid is None else self._solid[voxels]


def _distance(removed: RemovedField, voxels: np.ndarray) -> np.ndarray:
    """``(N,)`` mm, the distance to what was removed at voxels ``(N, 3)``, (z, y, x); far, outside the box."""
    place = voxels - removed.first[::-1]
    within = ((place >= 0) & (place < removed.distance_mm.shape)).all(axis=1)
    distance = np.full(len(voxels), _FAR_MM)
    distance[within] = removed.distance_mm[tuple(place[within].T)]
    return distance


def _overlap(
    first: tuple[int, ...], stop: tuple[int, ...], origin: tuple[int, ...], shape: tuple[int, ...]
) -> tuple[tuple[slice, ...], tuple[slice, ...]]:
    """Where a box of voxels overlaps an array that begins at voxel ``origin``: in the array, and in the box."""
    lower = [max(a, at) for a, at in zip(first, origin, strict=True)]
    upper = [max(low, min(b, at + n)) for low, b, at, n in zip(lower, stop, origin, shape, strict=True)]
    array = tuple(slice(low - at, high - at) for low, high, at in zip(lower, upper, origin, strict=True))
    box = tuple(slice(low - a, high - a) for low, high, a in zip(lower, upper, first, strict=True))
    return array, box


def _placed(points: np.ndarray, drilled: np.ndarray, faces: np.ndarray, grid: VoxelGrid) -> Isosurface:
    """The surface in LPS, from points in index space."""
    matrix = grid.mesh_from_index
    # not by a matrix product, whose last bits depend on the number of points
    vertices = np.stack([sum(points[:, i] * m[i] for i in range(3)) + m[3] for m in matrix[:3]], axis=1)
    if grid.is_left_handed:
        faces = np.ascontiguousarray(faces[:, ::-1])
    return Isosurface(TriangleMesh(vertices, faces), drilled)
