"""A surface under reduction as a whole: reduced in blocks, and brought back where it went too far.

Blocks fit into the cache, and several are worked on at a time. The vertices between them stay, and the next pass, whose
blocks lie elsewhere, reduces what is around those. The result does not depend on the number of threads.
"""

from collections import deque
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from itertools import count

import numpy as np

from .deviation import SurfaceTree
from .edge_collapse import EdgeCollapse, Patch
from .face_sides import creases, face_sides, folded
from .mesh import TriangleMesh
from .quadrics import QUADRIC_SIZE, vertex_quadrics
from .surface_blocks import THREADS, grouped, surface_blocks
from .triangle_distance import squared_triangle_distances
from .triangle_shape import face_shapes

PASSES = 3
"""After which all is done: the last one has a single block."""
_UNFOLDINGS = 20
"""How often more comes back where the original would fold over what stays; in noise there may be no end."""
_RINGS = 3
"""Faces around vertices between blocks that the next pass works on."""
_LEAST_PROGRESS = 0.002
"""Share of the vertices that a round must remove; the rest would take as long as all before for 1 % of the faces."""


class ReducedSurface:
    """The original, and what is left of it: mutable on purpose.

    A vertex that is left has the number of one of the original's that it stands for, and a face that of the one of the
    original that it was.

    """

    def __init__(self, mesh: TriangleMesh, tolerance_mm: np.ndarray) -> None:
        """Start from ``mesh`` with tolerances ``(V,)``, mm, of its vertices."""
        vertex_count, face_count = len(mesh.vertices), len(mesh.faces)
        self._original = mesh
        self._centre = mesh.bounds.mean(axis=0)
        self._tolerance, self._limit = tolerance_mm.copy(), tolerance_mm.copy()
        self._vertices = mesh.vertices - self._centre
        self._faces = mesh.faces.copy()
        self._quadrics = np.zeros((vertex_count, QUADRIC_SIZE))
        self._crease = np.ones(vertex_count)
        self._has_quadrics = False
        self._between, self._border = np.zeros((2, vertex_count), bool)
        self._vertex_of_point = np.arange(vertex_count, dtype=np.int32)
        self._face_of_point = np.full(vertex_count, -1, np.int32)
        for corner in mesh.faces.T:
            self._face_of_point[corner] = np.arange(face_count, dtype=np.int32)
        self._alive, self._changed = np.ones(face_count, bool), np.zeros(face_count, bool)

    def mesh(self) -> tuple[TriangleMesh, np.ndarray]:
        """The mesh as it is now, and ``(V,)`` for each vertex of the original a face that lies within its tolerance.

        The latter is -1 for vertices that no face uses.
        """
        corners, used = self._faces[self._alive], self._used()
        renamed = np.empty(len(self._vertices), np.int32)
        renamed[used] = np.arange(len(used), dtype=np.int32)
        place = np.append(np.cumsum(self._alive, dtype=np.int32) - 1, np.int32(-1))
        mesh = TriangleMesh(self._vertices[used] + self._centre, renamed[corners])
        return mesh, place[self._face_of_point]

    @property
    def vertex_count(self) -> int:
        """Vertices of :meth:`mesh`."""
        return len(self._used())

    @property
    def changed(self) -> np.ndarray:
        """``(N,)`` the faces of :meth:`mesh` that have changed since the last :meth:`settle`."""
        return np.flatnonzero(self._changed[self._alive])

    def settle(self, but: np.ndarray) -> None:
        """Count all faces as unchanged, ``but`` (N,) of them, by their numbers in :meth:`mesh`."""
        self._changed[:] = False
        self._changed[np.flatnonzero(self._alive)[but]] = True

    def reduce(self, active: np.ndarray, number: int, report: Callable[[float], None]) -> np.ndarray:
        """Do a pass of collapses among faces ``active`` (A,), in blocks.

        Parameters
        ----------
        number
            Of the pass, from 0; that of the last one is :data:`PASSES` - 1.
        report
            Called with the share done of the pass; it may raise to cancel.

        Returns
        -------
        The faces around the vertices between blocks, ``(B,)``, for the next pass.
        """
        blocks = [active]
        if number < PASSES - 1:
            blocks = surface_blocks(self._vertices[self._faces[active, 0]], number)
            blocks = [active[block] for block in blocks]
        block_of_face = np.full(len(self._alive), -1, np.int32)
        for block, faces in enumerate(blocks):
            block_of_face[faces] = block
        fixed, between = self._seams(active, block_of_face)
        block_of_point = block_of_face[self._face_of_point]
        block_of_point[self._face_of_point < 0] = -1
        points = grouped(block_of_point, len(blocks))
        heirs = np.arange(len(self._vertices), dtype=np.int32)
        with ThreadPoolExecutor(THREADS) as threads:
            pending = deque(
                threads.submit(self._collapsed, faces, at, fixed) for faces, at in zip(blocks, points, strict=True)
            )
            try:
                for block in range(len(blocks)):
                    # in their order, so that sums do not depend on which was ready first
                    self._take_over(pending.popleft().result(), heirs)
                    report((block + 1) / len(blocks))
            except BaseException:
                threads.shutdown(cancel_futures=True)
                raise
        self._has_quadrics = True
        self._between = between
        self._vertex_of_point = heirs[self._vertex_of_point]
        return self._around(between)

    def restore(self, points: np.ndarray, vertices: np.ndarray, factor: float) -> np.ndarray:
        """Bring back the original around vertices of it and of :meth:`mesh`, with ``factor`` of its tolerance.

        Parameters
        ----------
        points, vertices
            ``(N,)`` and ``(M,)`` numbers of the vertices.

        Returns
        -------
        The faces around it, ``(B,)``, to reduce again.

        Notes
        -----
        What the vertices became becomes single vertices again, while all else stays contracted, as in a
        vertex hierarchy (Luebke & Erikson, "View-dependent simplification of arbitrary polygonal environments", 1997).
        Where the two parts do not fit together, more comes back.
        """
        again = np.zeros(len(self._vertices), bool)
        again[self._vertex_of_point[points]] = True
        again[self._used()[vertices]] = True
        for turn in count():
            zone = again[self._vertex_of_point]
            original = self._original.faces
            around = np.flatnonzero(zone[original[:, 0]] | zone[original[:, 1]] | zone[original[:, 2]])
            own = original[around]
            corners = np.where(zone[own], own, self._vertex_of_point[own])
            left = (
                (corners[:, 0] != corners[:, 1]) & (corners[:, 1] != corners[:, 2]) & (corners[:, 2] != corners[:, 0])
            )
            own, corners, faces = own[left], corners[left], around[left]
            vertices = self._vertices.copy()
            vertices[zone] = self._original.vertices[zone] - self._centre
            # points of the zone belong to one of their own faces
            face_of_point = self._face_of_point.copy()
            single = np.flatnonzero(zone)
            face_of_point[single] = -1
            for corner in range(3):
                is_single = zone[own[:, corner]]
                face_of_point[own[is_single, corner]] = faces[is_single]
            lonely = single[face_of_point[single] < 0]
            beside = np.isin(original[around], lonely).any(axis=1)
            wrong = [self._vertex_of_point[original[around[beside]]].ravel()]
            wrong.append(self._unfit(vertices, zone, around, corners, turn < _UNFOLDINGS))
            place = np.full(len(self._alive), -1, np.int32)
            place[faces] = np.arange(len(faces), dtype=np.int32)
            wrong.append(self._astray(vertices, corners, faces, place, face_of_point, ~zone))
            more = np.concatenate(wrong)
            more = more[~again[more]]
            if len(more) == 0:
                break
            again[more] = True
        self._tolerance[single] *= factor
        self._limit[single] = self._tolerance[single]
        self._vertices, self._face_of_point = vertices, face_of_point
        self._vertex_of_point[single] = single
        self._alive[around] = left
        self._faces[faces] = corners
        self._changed[faces] = True
        self._measure_original(around, zone)
        changed = zone.copy()
        changed[corners] = True
        return self._around(changed)

    def _used(self) -> np.ndarray:
        """``(V,)`` the vertices that are left."""
        used = np.zeros(len(self._vertices), bool)
        used[self._faces[self._alive]] = True
        return np.flatnonzero(used)

    def _seams(self, active: np.ndarray, block_of_face: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """``(V,)`` bool: vertices of faces of several blocks or of none; and those of several blocks."""
        block_of_vertex = np.full(len(self._vertices), -1, np.int32)
        fixed, between = np.zeros((2, len(self._vertices)), bool)
        own = block_of_face[active]
        for corner in range(3):
            block_of_vertex[self._faces[active, corner]] = own
        for corner in range(3):
            vertex = self._faces[active, corner]
            between[vertex[block_of_vertex[vertex] != own]] = True
        others = np.flatnonzero(self._alive & (block_of_face < 0))
        fixed[self._faces[others]] = True
        return fixed | between, between

    def _collapsed(self, faces: np.ndarray, points: np.ndarray, fixed: np.ndarray) -> "_Block":
        """Reduce the patch of ``faces``; works beside others, and changes nothing."""
        vertex, corners = np.unique(self._faces[faces].T, return_inverse=True)
        corners = corners.reshape(3, -1)
        vertices = np.ascontiguousarray(self._vertices[vertex].T)
        sides = face_sides(corners, len(vertex))
        normals, quality = face_shapes(vertices, corners)
        crease = creases(corners, normals, sides)
        if self._has_quadrics:
            quadrics = np.ascontiguousarray(self._quadrics[vertex].T)
            # what lay between blocks has not been measured
            crease = np.minimum(self._crease[vertex], np.where(self._between[vertex], crease, 1))
        else:
            quadrics = vertex_quadrics(vertices, corners)
        own_fixed = fixed[vertex]
        place = np.searchsorted(faces, self._face_of_point[points])
        patch = Patch(
            vertices, corners, quadrics, self._limit[vertex], crease, own_fixed | sides.border,
            np.ascontiguousarray((self._original.vertices[points] - self._centre).T), self._tolerance[points], place,
        )  # fmt: skip
        state = EdgeCollapse(patch, sides, normals, quality, folded(corners, normals, sides, crease))
        while _pays(state):
            pass
        state.compact()
        return _Block(faces, points, vertex, own_fixed, sides.border & ~own_fixed, state)

    def _take_over(self, block: "_Block", heirs: np.ndarray) -> None:
        """Take over what became of a block."""
        state, left = block.state, block.faces[block.state.face]
        vertex, own = block.vertex[state.vertex], ~block.fixed[state.vertex]
        self._alive[block.faces] = False
        self._alive[left] = True
        self._changed[left[state.changed]] = True
        self._faces[left] = block.vertex[state.vertex[state.faces]].T
        heirs[block.vertex] = block.vertex[state.heirs]
        self._face_of_point[block.points] = left[state.face_of_point]
        self._border[block.vertex[block.border]] = True
        if not self._has_quadrics:
            # each of the blocks around a vertex between them has a part
            self._quadrics[vertex] += state.quadrics.T
            self._crease[vertex] = np.minimum(self._crease[vertex], state.crease)
        own_vertex = vertex[own]
        self._vertices[own_vertex] = state.vertices.T[own]
        self._quadrics[own_vertex] = state.quadrics.T[own]
        self._limit[own_vertex], self._crease[own_vertex] = state.limit[own], state.crease[own]

    def _around(self, vertices: np.ndarray) -> np.ndarray:
        """Faces left in a few rings around vertices ``(V,)`` bool."""
        if not vertices.any():
            return np.empty(0, np.intp)
        alive = np.flatnonzero(self._alive)
        corners = self._faces[alive]
        near = vertices.copy()
        for ring in range(_RINGS):
            touched = near[corners[:, 0]] | near[corners[:, 1]] | near[corners[:, 2]]
            if ring < _RINGS - 1:
                near[corners[touched]] = True
        return alive[touched]

    def _unfit(
        self, vertices: np.ndarray, zone: np.ndarray, around: np.ndarray, corners: np.ndarray, unfold: bool
    ) -> np.ndarray:
        """Vertices of faces with ``corners`` (N, 3), in place of those ``around``, that tear or fold the surface."""
        ours = np.zeros(len(self._vertices), bool)
        ours[corners] = True
        unchanged = self._alive.copy()
        unchanged[around] = False
        other = np.flatnonzero(unchanged)
        other = other[ours[self._faces[other]].any(axis=1)]
        together = np.concatenate([corners, self._faces[other]])
        vertex, local = np.unique(together.T, return_inverse=True)
        local = local.reshape(3, -1)
        sides = face_sides(local, len(vertex))
        # all faces at our vertices are here; the others' are not
        torn = np.zeros(len(self._vertices), bool)
        torn[vertex[sides.border]] = True
        torn &= ours & ~self._border
        unfit = torn[together].any(axis=1)
        if unfold:
            normals, _ = face_shapes(np.ascontiguousarray(vertices[vertex].T), local)
            bad = folded(local, normals, sides, self._crease[self._vertex_of_point[vertex]])
            # those between the two parts
            unfit[: len(corners)] |= bad[: len(corners)] & ~zone[corners].all(axis=1)
        return together[unfit].ravel()

    def _astray(
        self,
        vertices: np.ndarray,
        corners: np.ndarray,
        faces: np.ndarray,
        place: np.ndarray,
        face_of_point: np.ndarray,
        kept: np.ndarray,
    ) -> np.ndarray:
        """Vertices whose points have no face within tolerance any more; finds new faces for others, in place."""
        points = np.flatnonzero(kept & (face_of_point >= 0))
        points = points[place[face_of_point[points]] >= 0]
        at = self._original.vertices[points].T - self._centre[:, None]
        start, first, second = (vertices[corner].T for corner in corners[place[face_of_point[points]]].T)
        squared = squared_triangle_distances(first - start, second - start, at - start)
        astray = squared > self._tolerance[points] ** 2
        points, at = points[astray], at[:, astray]
        if len(points) == 0:
            return points
        distance, nearest = SurfaceTree(TriangleMesh(vertices, corners)).nearest(at.T)
        found = distance <= self._tolerance[points]
        face_of_point[points[found]] = faces[nearest[found]]
        return self._vertex_of_point[points[~found]]

    def _measure_original(self, around: np.ndarray, zone: np.ndarray) -> None:
        """Quadrics and creases of the original at the vertices of the zone, whose faces are ``around``."""
        vertex, corners = np.unique(self._original.faces[around].T, return_inverse=True)
        corners = corners.reshape(3, -1)
        vertices = np.ascontiguousarray((self._original.vertices[vertex] - self._centre).T)
        quadrics = vertex_quadrics(vertices, corners)
        crease = creases(corners, face_shapes(vertices, corners)[0], face_sides(corners, len(vertex)))
        own = zone[vertex]
        self._quadrics[vertex[own]], self._crease[vertex[own]] = quadrics.T[own], crease[own]


@dataclass(frozen=True)
class _Block:
    """What became of a block: its faces and points, its vertices ``(V,)``, which of them stay and lie on a border."""

    faces: np.ndarray
    points: np.ndarray
    vertex: np.ndarray
    fixed: np.ndarray
    border: np.ndarray
    state: EdgeCollapse


def _pays(state: EdgeCollapse) -> bool:
    """Do a round of collapses; whether another one pays."""
    before = state.vertex_count
    tried, removed = state.collapse()
    return tried > 0 and (removed >= tried / 3 or removed + 1 >= _LEAST_PROGRESS * before)
