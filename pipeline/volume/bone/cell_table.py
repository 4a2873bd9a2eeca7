"""The triangles of a cell of eight voxels, for each of the 256 ways that its corners lie in material or in air.

The table of marching cubes (Lorensen & Cline, SIGGRAPH 1987), derived instead of copied. On every face of the cell the
contour cuts off each run of material corners, so on an ambiguous face, with material on one diagonal, the air is
joined. The rule depends on the face alone: two cells agree on the face between them, and the surface is closed
(Montani, Scateni & Scopigno, "A modified look-up table for implicit disambiguation of marching cubes", The Visual
Computer 1994). The contours of the six faces join to loops, and no diagonal of a loop's triangles lies in a face, where
the neighbouring cell might have the same one: every edge has exactly two triangles.

Corner ``c`` lies at ``(x, y, z) = (c & 1, c >> 1 & 1, c >> 2 & 1)``.
"""

from dataclasses import dataclass
from functools import cache

import numpy as np

EDGES = tuple((axis, corner) for axis in range(3) for corner in range(8) if not corner >> axis & 1)
"""Axis and lower corner of each of the twelve edges of a cell."""

_Loop = tuple[int, ...]


@dataclass(frozen=True)
class CellTable:
    """Triangles of all cases; bit ``c`` of a case is set where corner ``c`` is material.

    Attributes
    ----------
    count
        ``(256,)`` int64 number of triangles.
    first
        ``(256,)`` int64 index of the first one in ``triangles``.
    triangles
        ``(N, 3)`` uint8 edges of the cell, counter-clockwise seen from the air.
    """

    count: np.ndarray
    first: np.ndarray
    triangles: np.ndarray


@cache
def cell_table() -> CellTable:
    """The table of all cases."""
    triangles = [[part for loop in _loops(case) for part in _triangulated(loop)] for case in range(256)]
    count = np.array([len(each) for each in triangles])
    flat = np.array([triangle for each in triangles for triangle in each], np.uint8)
    return CellTable(count, np.cumsum(count) - count, flat)


def _faces() -> list[tuple[int, int, int, int]]:
    """Corners of the six faces, counter-clockwise seen from outside the cell."""
    faces = []
    for axis in range(3):
        u, v = 1 << (axis + 1) % 3, 1 << (axis + 2) % 3
        faces.append((0, v, u | v, u))
        side = 1 << axis
        faces.append((side, side | u, side | u | v, side | v))
    return faces


_FACES = _faces()


def _edge(a: int, b: int) -> int:
    """The edge between two corners."""
    return EDGES.index(((a ^ b).bit_length() - 1, min(a, b)))


_EDGES_OF_FACE = [{_edge(face[i - 1], face[i]) for i in range(4)} for face in _FACES]


def _loops(case: int) -> list[_Loop]:
    """Closed rows of edges where the surface leaves material, material on the left of each face's contour."""
    following = {}
    for face in _FACES:
        for i in range(4):
            if not case >> face[i - 1] & 1 and case >> face[i] & 1:
                stop = i
                while case >> face[stop % 4] & 1:
                    stop += 1
                following[_edge(face[i - 1], face[i])] = _edge(face[(stop - 1) % 4], face[stop % 4])
    loops = []
    while following:
        start, edge = following.popitem()
        loop = [start]
        while edge != start:
            loop.append(edge)
            edge = following.pop(edge)
        # from the lowest edge on, whatever the order of the faces
        lowest = loop.index(min(loop))
        loops.append((*loop[lowest:], *loop[:lowest]))
    return sorted(loops)


def _triangulated(loop: _Loop) -> list[_Loop]:
    """Triangles that fill a loop; no side of them but those of the loop lies in a face of the cell."""
    found = _filled(loop)
    if found is None:
        raise ValueError(f"loop {loop}: every triangulation has a side in a face of the cell")
    return found


def _filled(loop: _Loop) -> list[_Loop] | None:
    if len(loop) < 3:
        return []
    for k in range(1, len(loop) - 1):
        apart = (k == 1 or _is_inside(loop[0], loop[k])) and (k == len(loop) - 2 or _is_inside(loop[k], loop[-1]))
        if not apart:
            continue
        before, after = _filled(loop[: k + 1]), _filled(loop[k:])
        if before is not None and after is not None:
            return [*before, (loop[0], loop[k], loop[-1]), *after]
    return None


def _is_inside(a: int, b: int) -> bool:
    """Whether the line between points on two edges runs through the cell, in none of its faces."""
    return not any(a in edges and b in edges for edges in _EDGES_OF_FACE)
