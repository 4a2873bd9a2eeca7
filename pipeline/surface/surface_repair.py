"""Puts vertices where a reduced surface lies too far from its original: a few, so one after the other.

A face or an edge gets a vertex part of the way to the original; a vertex moves. What would fold the surface over or
make slivers is left as it is.
"""

from itertools import combinations

import numpy as np

from .face_sides import SHARPEST_COSINE
from .mesh import TriangleMesh
from .tolerance_guard import Excess
from .triangle_shape import shapes

_PARTS = (0.6, 0.4, 0.2)
"""Of the way to the original, the first that fits."""
_SHARPER = 0.1
"""How much smaller the cosine between two faces may be than between those that were there, if these were sharp."""
_SMALLEST_QUALITY = 0.05


def repaired(
    mesh: TriangleMesh, limit: np.ndarray, excess: Excess, smallest_cosine: float = SHARPEST_COSINE
) -> tuple[TriangleMesh, np.ndarray, np.ndarray, int]:
    """Bring the surface nearer to the original where it exceeds its tolerance.

    Parameters
    ----------
    limit
        ``(V,)`` tolerances of the vertices, mm.
    smallest_cosine
        Between the normals of neighbouring faces, and of a face before and after, where there was no crease.

    Returns
    -------
    The surface, whose faces keep their numbers, with new ones at the end; its tolerances; the faces ``(N,)`` that have
    changed or still exceed theirs; the number of samples that were brought nearer.
    """
    repair = _Repair(mesh, limit, excess, smallest_cosine)
    for corners, base, target in zip(excess.corners, excess.base, excess.target, strict=True):
        repair.bring_nearer(sorted(set(corners.tolist())), base, target)
    vertices = np.concatenate([mesh.vertices, np.array(repair.new_vertices).reshape(-1, 3)])
    for vertex, position in repair.moved.items():
        vertices[vertex] = position
    faces = np.concatenate([mesh.faces, np.zeros((len(repair.new_faces), 3), mesh.faces.dtype)])
    changed = sorted(repair.changed)
    faces[changed] = np.array([repair.faces[face] for face in changed]).reshape(-1, 3)
    due = np.union1d(changed, repair.left).astype(np.intp)
    return TriangleMesh(vertices, faces), np.append(limit, repair.new_limits), due, repair.count


class _Repair:
    """The faces around the samples, under change."""

    def __init__(self, mesh: TriangleMesh, limit: np.ndarray, excess: Excess, smallest_cosine: float) -> None:
        self._vertices, self._limit, self._smallest_cosine = mesh.vertices, limit, smallest_cosine
        wanted = np.zeros(len(mesh.vertices), bool)
        wanted[excess.corners] = True
        for _ in range(2):
            around = wanted[mesh.faces].any(axis=1)
            wanted[mesh.faces[around]] = True
        self.faces = {int(face): tuple(mesh.faces[face].tolist()) for face in np.flatnonzero(around)}
        self._faces_of: dict[int, set[int]] = {}
        for face, corners in self.faces.items():
            for corner in corners:
                self._faces_of.setdefault(corner, set()).add(face)
        self._face_count = len(mesh.faces)
        self._claimed: set[int] = set()
        self.new_vertices: list[np.ndarray] = []
        self.new_limits: list[float] = []
        self.new_faces: list[int] = []
        self.moved: dict[int, np.ndarray] = {}
        self.changed: set[int] = set()
        self.left: list[int] = []
        self.count = 0

    def bring_nearer(self, corners: list[int], base: np.ndarray, target: np.ndarray) -> None:
        """Change what lies at ``corners``, 1 to 3, so that it passes nearer to ``target`` than ``base`` does."""
        old = set.intersection(*(self._faces_of[corner] for corner in corners))
        around = {corner for face in old for corner in self.faces[face]}
        done = False
        if not around & self._claimed and len(old) == (0, len(old), 2, 1)[len(corners)]:
            done = any(self._change(corners, sorted(old), base + part * (target - base)) for part in _PARTS)
        if done:
            self._claimed |= around
            self.count += 1
        else:
            self.left += old

    def _change(self, corners: list[int], old: list[int], position: np.ndarray) -> bool:
        """Put a vertex at ``position`` in faces ``old``, unless that makes bad shapes."""
        new = len(self._vertices) + len(self.new_vertices)
        triangles = [each for face in old for each in self._with_vertex(face, corners, new)]
        vertex = corners[0] if len(corners) == 1 else new
        if not self._fits(triangles, old, vertex, position):
            return False
        if vertex == new:
            self.new_vertices.append(position)
            self.new_limits.append(min(self._limit_of(corner) for face in old for corner in self.faces[face]))
            self._faces_of[new] = set()
        else:
            self.moved[vertex] = position
        for face in old:
            for corner in self.faces[face]:
                self._faces_of[corner].discard(face)
        free = list(old)
        for triangle, _ in triangles:
            face = free.pop(0) if free else self._face_count
            if face == self._face_count:
                self._face_count += 1
                self.new_faces.append(face)
            self.faces[face] = triangle
            self.changed.add(face)
            for corner in triangle:
                self._faces_of[corner].add(face)
        return True

    def _with_vertex(self, face: int, corners: list[int], new: int) -> list[tuple[tuple[int, int, int], int]]:
        """The triangles in place of a face, and the face: itself, or two or three with the new vertex."""
        a, b, c = self.faces[face]
        if len(corners) == 1:
            return [((a, b, c), face)]
        sides = ((a, b), (b, c), (c, a))
        split = [set(side) == set(corners) for side in sides]
        # each side with the new vertex, but the one that it lies on
        return [((one, other, new), face) for (one, other), lies_on in zip(sides, split, strict=True) if not lies_on]

    def _fits(
        self, triangles: list[tuple[tuple[int, int, int], int]], old: list[int], vertex: int, position: np.ndarray
    ) -> bool:
        """Whether no triangle is a sliver, turns away from its face, or folds over a neighbour."""
        before = {face: self._shape(self.faces[face]) for face in old}
        after = [self._shape(triangle, vertex, position) for triangle, _ in triangles]
        for (_, face), (normal, quality) in zip(triangles, after, strict=True):
            if normal @ before[face][0] < self._smallest_cosine or quality < min(_SMALLEST_QUALITY, before[face][1]):
                return False
        sharpest = min((before[one][0] @ before[other][0] for one, other in combinations(old, 2)), default=1.0)
        outer = []
        for (triangle, face), (normal, _) in zip(triangles, after, strict=True):
            for other in self._beyond(triangle, old):
                beside = self._shape(self.faces[other])[0]
                outer.append(normal @ beside)
                sharpest = min(sharpest, before[face][0] @ beside)
        inner = [
            one[0] @ other[0]
            for (first, one), (second, other) in combinations(list(zip(triangles, after, strict=True)), 2)
            if len(set(first[0]) & set(second[0])) == 2
        ]
        return min(outer + inner, default=1.0) >= min(self._smallest_cosine, sharpest - _SHARPER)

    def _beyond(self, triangle: tuple[int, int, int], old: list[int]) -> list[int]:
        """The faces beside a triangle that stay."""
        a, b, c = (self._faces_of.get(corner, set()) for corner in triangle)
        return sorted(((a & b) | (b & c) | (c & a)) - set(old))

    def _shape(
        self, triangle: tuple[int, int, int], vertex: int = -1, position: np.ndarray | None = None
    ) -> tuple[np.ndarray, float]:
        a, b, c = (
            position if position is not None and corner == vertex else self._position(corner) for corner in triangle
        )
        normal, quality = shapes((b - a)[:, None], (c - a)[:, None])
        return normal[:, 0], float(quality[0])

    def _position(self, vertex: int) -> np.ndarray:
        if vertex in self.moved:
            return self.moved[vertex]
        count = len(self._vertices)
        return self._vertices[vertex] if vertex < count else self.new_vertices[vertex - count]

    def _limit_of(self, vertex: int) -> float:
        count = len(self._vertices)
        return float(self._limit[vertex]) if vertex < count else self.new_limits[vertex - count]
