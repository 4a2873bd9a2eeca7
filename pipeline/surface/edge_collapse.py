"""Rounds of edge collapses that keep every vertex of the original surface within its tolerance.

In a round, edges collapse that share no face and cost less than all edges around them, so that numpy does them
together and the result is that of one after the other. The vertices of the original are *tracked*: each knows a face
of the reduced surface that lies within its tolerance, and a collapse that leaves one without is refused.

Sources: Garland & Heckbert (1997) for cost and position; Klein et al., "Mesh reduction with error control" (1996) for
tracking the distance.
"""

import numpy as np

from .deviation import SurfaceTree
from .edge_stars import EdgeStars
from .mesh import TriangleMesh
from .quadrics import best_positions, vertex_quadrics
from .triangle_distance import squared_triangle_distances

_BLOCK = 1 << 14
_SELECTIONS = 3
"""Passes over the edges in a round, each among what the former left free."""
_COST_BITS = 20
"""Last bits of the cost that do not count: with three left of the mantissa, costs rank by steps of an eighth."""
_MOST_RMS = 0.5
"""Root mean square distance of a new vertex from the planes it stands for, relative to the tolerance. Higher gives few
faces less, and dozens of collapses that the measured distance refuses."""


class EdgeCollapse:
    """A mesh under reduction: mutable on purpose, as a round changes a part of it.

    Attributes
    ----------
    faces
        ``(3, F)`` vertices of the faces left.
    face_of_point
        ``(P,)`` for each vertex of the original a face that lies within its tolerance.
    fresh
        ``(F,)`` bool: the face has changed since the caller set it to ``False``.
    """

    def __init__(self, mesh: TriangleMesh, tolerance_mm: np.ndarray) -> None:
        """Start from ``mesh`` with tolerances ``(V,)``, mm, of its vertices."""
        self._centre = mesh.bounds.mean(axis=0)
        self._points = np.ascontiguousarray((mesh.vertices - self._centre).T)
        self._rounding = 1e-7 * float(np.ptp(mesh.bounds, axis=0).max())
        self._tolerance = np.maximum(tolerance_mm, self._rounding)
        self._vertices = self._points.copy()
        self.faces = np.ascontiguousarray(mesh.faces.T.astype(np.intp))
        self._quadrics = vertex_quadrics(self._vertices, self.faces)
        self._original_faces, self._original_quadrics = mesh.faces.T, self._quadrics
        self._original_face = np.arange(self.faces.shape[1])
        self._vertex_of_point = np.arange(len(mesh.vertices))
        self.fresh = np.ones(self.faces.shape[1], bool)
        self._limit = self._tolerance.copy()
        self._edges, self._locked = _edges(self.faces, len(mesh.vertices))
        self._border = self._locked
        self.face_of_point = np.full(len(mesh.vertices), -1)
        for corner in self.faces:
            self.face_of_point[corner] = np.arange(self.faces.shape[1])
        # vertices that no face uses are no part of the surface: any distance will do
        self._tolerance[self.face_of_point < 0] = np.inf
        self._cost = self._costs(self._edges)
        self._vertex_count = len(mesh.vertices)

    @property
    def vertex_count(self) -> int:
        """Vertices left."""
        return self._vertex_count

    @property
    def mesh(self) -> TriangleMesh:
        """The mesh as it is now; its faces are in the order of :attr:`faces`."""
        self._compact()
        vertices = np.ascontiguousarray(self._vertices.T) + self._centre
        return TriangleMesh(vertices, np.ascontiguousarray(self.faces.T.astype(np.int32)))

    def restore(self, vertices: np.ndarray, points: np.ndarray, factor: float) -> None:
        """Bring back the original at ``vertices`` and original vertices ``points``, with ``factor`` of its tolerance.

        Notes
        -----
        What the vertices stand for becomes single vertices again, while all else stays contracted, as in a
        vertex hierarchy (Luebke & Erikson, "View-dependent simplification of arbitrary polygonal environments", 1997).
        Where the two parts do not fit together, more comes back.
        """
        again = np.zeros(self._vertices.shape[1], bool)
        again[vertices] = True
        again[self._vertex_of_point[points]] = True
        while True:
            zone = again[self._vertex_of_point]
            single = np.flatnonzero(zone)
            vertex_of_point = self._vertex_of_point.copy()
            vertex_of_point[single] = len(again) + np.arange(len(single))
            vertices = np.concatenate([self._vertices, self._points[:, single]], axis=1)
            original_face = self._original_faces_left(vertex_of_point)
            corners = vertex_of_point[self._original_faces[:, original_face]]
            edges, locked = _edges(corners, vertices.shape[1])
            place = np.full(self._original_faces.shape[1], -1)
            place[original_face] = np.arange(len(original_face))
            face_of_point = place[self._original_face[self.face_of_point]]
            own = zone[self._original_faces]
            for corner, is_single in zip(self._original_faces[:, original_face], own[:, original_face], strict=True):
                face_of_point[corner[is_single]] = np.flatnonzero(is_single)
            # outside the zone: vertices no longer on discs, and points whose face moved away from them
            border = np.zeros(vertices.shape[1], bool)
            border[vertex_of_point[self._border]] = True
            torn = np.flatnonzero(locked & ~border)
            astray = self._astray(vertices, corners, face_of_point, np.flatnonzero(~zone))
            if len(astray):
                changed = np.flatnonzero((corners >= len(again)).any(axis=0))
                tree = SurfaceTree(TriangleMesh(vertices.T, corners[:, changed].T))
                distance, nearest = tree.nearest(self._points[:, astray].T)
                found = distance <= self._tolerance[astray]
                face_of_point[astray[found]] = changed[nearest[found]]
                astray = astray[~found]
            wrong = np.concatenate([torn[torn < len(again)], self._vertex_of_point[astray]])
            around = np.isin(corners, torn).any(axis=0)
            near = corners[:, around].ravel()
            wrong = np.concatenate([wrong, near[near < len(again)]])
            if len(wrong) == 0:
                break
            again[wrong] = True
        self._tolerance[single] = np.maximum(self._tolerance[single] * factor, self._rounding)
        unchanged = np.zeros(self._original_faces.shape[1], bool)
        unchanged[self._original_face[~self.fresh]] = True
        self.fresh = ~unchanged[original_face] | (corners >= len(again)).any(axis=0)
        self._vertices, self.faces, self._original_face = vertices, corners, original_face
        self._quadrics = np.concatenate([self._quadrics, self._original_quadrics[:, single]], axis=1)
        self._limit = np.concatenate([self._limit, self._tolerance[single]])
        self._vertex_of_point, self.face_of_point = vertex_of_point, face_of_point
        self._edges, self._locked = edges, border
        self._compact()
        self._cost = self._costs(self._edges)

    def _original_faces_left(self, vertex_of_point: np.ndarray) -> np.ndarray:
        """Original faces whose corners stand for three vertices: those that are left of the surface."""
        a, b, c = (vertex_of_point[corner] for corner in self._original_faces)
        return np.flatnonzero((a != b) & (b != c) & (c != a))

    def _astray(
        self, vertices: np.ndarray, faces: np.ndarray, face_of_point: np.ndarray, points: np.ndarray
    ) -> np.ndarray:
        """Those of ``points`` (N,) that lie farther than their tolerance from the face that tracks them."""
        start, first, second = (np.take(vertices, corner[face_of_point[points]], axis=1) for corner in faces)
        squared = squared_triangle_distances(first - start, second - start, self._points[:, points] - start)
        return points[squared > self._tolerance[points] ** 2]

    def collapse(self) -> tuple[int, int]:
        """One round: the numbers of edges that it tried and of those that it collapsed."""
        chosen = self._selected()
        if len(chosen) == 0:
            return 0, 0
        first, second = self._edges[:, chosen]
        position = best_positions(self._vertices, self._quadrics, first, second)[0]
        stars = EdgeStars(self._vertices, self.faces, first, second, position)
        good = stars.good
        tracked, face = self._tracked(stars, good)
        self._cost[chosen[~good]] = np.inf
        kept = good[stars.of_face[self.face_of_point[tracked]]]
        self.face_of_point[tracked[kept]] = face[kept]
        self._commit(stars, first[good], second[good], position[:, good], good)
        return len(chosen), int(good.sum())

    def _costs(self, edges: np.ndarray) -> np.ndarray:
        """``(E,)`` float32; infinite where the collapse is out of the question."""
        first, second = edges
        _, mean_squared, cost = best_positions(self._vertices, self._quadrics, first, second)
        limit = _MOST_RMS * np.minimum(self._limit[first], self._limit[second])
        cost[(mean_squared > limit * limit) | self._locked[first] | self._locked[second]] = np.inf
        return cost.astype(np.float32)

    def _selected(self) -> np.ndarray:
        """Indices of edges whose ends have no edge between them: by falling local minima of the cost."""
        free = np.flatnonzero(np.isfinite(self._cost))
        # the bits of a float that is not negative rank as it does. Without the last ones, costs that differ by less
        # than a part are equal, and equal ones scattered, or a smooth slope of costs would have one minimum only
        scattered = (free.astype(np.uint64) * np.uint64(2654435761)) & np.uint64(0xFFFFFFFF)
        key = ((self._cost[free].view(np.int32) >> _COST_BITS).astype(np.int64) << 32) | scattered.astype(np.int64)
        first, second = self._edges[:, free]
        all_first, all_second = self._edges
        taken = np.zeros(self._vertices.shape[1], bool)
        chosen = []
        for _ in range(_SELECTIONS):
            if len(free) == 0:
                break
            lowest = np.full(len(taken), np.iinfo(np.int64).max)
            np.minimum.at(lowest, first, key)
            np.minimum.at(lowest, second, key)
            around = lowest.copy()
            np.minimum.at(around, all_first, lowest[all_second])
            np.minimum.at(around, all_second, lowest[all_first])
            least = (around[first] == key) & (around[second] == key)
            chosen.append(free[least])
            collapsing = np.zeros(len(taken), bool)
            collapsing[first[least]] = collapsing[second[least]] = True
            taken |= collapsing
            taken[all_second[collapsing[all_first]]] = True
            taken[all_first[collapsing[all_second]]] = True
            left = ~(taken[first] | taken[second])
            free, key, first, second = free[left], key[left], first[left], second[left]
            left = ~(taken[all_first] | taken[all_second])
            all_first, all_second = all_first[left], all_second[left]
        return np.sort(np.concatenate(chosen)) if chosen else free

    def _tracked(self, stars: EdgeStars, good: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The original vertices that the collapses touch, and their new faces; ``good`` loses collapses that fail."""
        star = stars.of_face[self.face_of_point]
        points = np.flatnonzero((star >= 0) & good[star])
        star = star[points]
        row = stars.row_of_face[self.face_of_point[points]]
        limit = self._tolerance[points] ** 2
        squared = np.full(len(points), np.inf)
        same = np.flatnonzero(row >= 0)
        for at in range(0, len(same), _BLOCK):
            block = same[at : at + _BLOCK]
            squared[block] = stars.squared_distances(row[block], self._points[:, points[block]])
        lost = np.flatnonzero(squared > limit)
        # the farthest point of each star first: most of the collapses that fail, fail by it
        outside = lost[row[lost] >= 0]
        excess = squared[outside] / limit[outside]
        farthest = np.zeros(len(good))
        np.maximum.at(farthest, star[outside], excess)
        worst = outside[excess == farthest[star[outside]]]
        nearest, _ = stars.nearest(star[worst], self._points[:, points[worst]])
        good[star[worst[nearest > limit[worst]]]] = False
        lost = lost[good[star[lost]]]
        nearest, row[lost] = stars.nearest(star[lost], self._points[:, points[lost]])
        good[star[lost[nearest > limit[lost]]]] = False
        return points, stars.face[row]

    def _commit(
        self, stars: EdgeStars, first: np.ndarray, second: np.ndarray, position: np.ndarray, good: np.ndarray
    ) -> None:
        self._vertices[:, first] = position
        self._quadrics[:, first] += self._quadrics[:, second]
        self._limit[first] = np.minimum(self._limit[first], self._limit[second])
        self._vertex_count -= len(first)
        kept = np.ones(self.faces.shape[1], bool)
        kept[stars.removed_face[good[stars.removed_star]]] = False
        self.fresh[stars.face[good[stars.star]]] = True
        self.face_of_point = (np.cumsum(kept) - 1)[self.face_of_point]
        renamed = np.arange(self._vertices.shape[1])
        renamed[second] = first
        self.faces = renamed[self.faces[:, kept]]
        self._original_face, self.fresh = self._original_face[kept], self.fresh[kept]
        self._vertex_of_point = renamed[self._vertex_of_point]
        moved = np.zeros(len(renamed), bool)
        moved[first] = True
        self._edges = renamed[self._edges]
        changed = moved[self._edges[0]] | moved[self._edges[1]]
        edges = _unique_edges(self._edges[:, changed], len(renamed))
        costs = self._costs(edges)
        self._edges = np.concatenate([self._edges[:, ~changed], edges], axis=1)
        self._cost = np.concatenate([self._cost[~changed], costs])
        if 2 * self._vertex_count < len(renamed):
            self._compact()

    def _compact(self) -> None:
        """Forget the vertices that no face uses, so that a round costs what is left."""
        used = np.zeros(self._vertices.shape[1], bool)
        used[self.faces] = True
        renamed = np.cumsum(used) - 1
        self.faces, self._edges = renamed[self.faces], renamed[self._edges]
        self._vertex_of_point = renamed[self._vertex_of_point]
        self._vertices, self._quadrics = self._vertices[:, used], self._quadrics[:, used]
        self._limit, self._locked = self._limit[used], self._locked[used]
        self._vertex_count = int(used.sum())


def _edges(faces: np.ndarray, vertex_count: int) -> tuple[np.ndarray, np.ndarray]:
    """``(2, E)`` edges of faces ``(3, F)``; ``(V,)`` bool: vertices on a border, a seam or an edge of many faces."""
    start, end = faces.ravel(), faces[[1, 2, 0]].ravel()
    # the lowest bit is the direction: an inner edge has both, once
    key = np.sort((np.minimum(start, end) * vertex_count + np.maximum(start, end)) * 2 + (start > end))
    edge = key >> 1
    first = np.flatnonzero(np.append(True, edge[1:] != edge[:-1]))
    size = np.diff(np.append(first, len(edge)))
    inner = size == 2
    inner[inner] = key[first[inner]] != key[first[inner] + 1]
    edges = np.stack([edge[first] // vertex_count, edge[first] % vertex_count])
    locked = np.zeros(vertex_count, bool)
    locked[edges[:, ~inner]] = True
    return edges, locked


def _unique_edges(edges: np.ndarray, vertex_count: int) -> np.ndarray:
    """``(2, E)`` edges, each once, without those from a vertex to itself."""
    first, second = edges
    key = np.sort((np.minimum(first, second) * vertex_count + np.maximum(first, second))[first != second])
    key = key[np.append(True, key[1:] != key[:-1])] if len(key) else key
    return np.stack([key // vertex_count, key % vertex_count])
