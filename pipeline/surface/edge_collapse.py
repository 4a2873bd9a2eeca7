"""Rounds of edge collapses that keep every vertex of the original surface within its tolerance.

In a round, edges collapse that share no face and cost less than all edges around them, so that numpy does them
together and the result is that of one after the other. The vertices of the original are *tracked*: each knows a face
of the reduced surface that lies within its tolerance, and a collapse that leaves one without is refused.

Sources: Garland & Heckbert (1997) for cost and position; Klein et al., "Mesh reduction with error control" (1996) for
tracking the distance.
"""

from dataclasses import dataclass

import numpy as np

from .edge_stars import EdgeStars
from .face_sides import Sides
from .quadrics import best_positions

_BLOCK = 1 << 14
_SELECTIONS = 3
"""Passes over the edges in a round, each among what the former left free."""
_COST_BITS = 20
"""Last bits of the cost that do not count: with three left of the mantissa, costs rank by steps of an eighth."""
_MOST_RMS = 0.5
"""Root mean square distance of a new vertex from the planes it stands for, relative to the tolerance. Higher gives few
faces less, and dozens of collapses that the measured distance refuses."""


@dataclass(frozen=True)
class Patch:
    """A part of a surface under reduction, in indices of its own.

    Attributes
    ----------
    vertices, faces
        ``(3, V)``, mm, and ``(3, F)``.
    quadrics, limit, crease
        ``(11, V)``; ``(V,)`` tolerances, mm; ``(V,)`` cosine of the sharpest crease of the original.
    fixed
        ``(V,)`` bool: vertices that stay.
    points, tolerance, face_of_point
        ``(3, P)`` vertices of the original, ``(P,)`` their tolerances, mm, and a face that lies within.
    """

    vertices: np.ndarray
    faces: np.ndarray
    quadrics: np.ndarray
    limit: np.ndarray
    crease: np.ndarray
    fixed: np.ndarray
    points: np.ndarray
    tolerance: np.ndarray
    face_of_point: np.ndarray


class EdgeCollapse:
    """A patch under reduction: mutable on purpose, as a round changes a part of it.

    Attributes
    ----------
    faces, face
        ``(3, F)`` vertices of the faces left, and ``(F,)`` which of the patch they were.
    vertices, vertex, quadrics, limit, crease
        ``(3, V)`` positions, ``(V,)`` which of the patch they were, and what they have.
    face_of_point
        ``(P,)`` for each vertex of the original a face that lies within its tolerance.
    changed
        ``(F,)`` bool: faces that have changed.
    """

    def __init__(
        self, patch: Patch, sides: Sides, normals: np.ndarray, quality: np.ndarray, folded: np.ndarray
    ) -> None:
        """Start from ``patch``; unit normals ``(3, F)``, quality ``(F,)`` and folds ``(F,)`` bool are of its faces."""
        self._points, self._tolerance = patch.points, patch.tolerance
        self.vertices, self.faces = patch.vertices.copy(), patch.faces
        self.quadrics, self.limit, self.crease = patch.quadrics.copy(), patch.limit.copy(), patch.crease.copy()
        self.face_of_point = patch.face_of_point
        self.face, self.vertex = np.arange(self.faces.shape[1]), np.arange(self.vertices.shape[1])
        self.changed = np.zeros(self.faces.shape[1], bool)
        self._heir = np.arange(self.vertices.shape[1])
        self._fixed = patch.fixed
        self._neighbours = sides.neighbours
        self._edges = sides.edges
        self._normals, self._quality, self._folded = normals, quality, folded
        self._cost = self._costs(self._edges)
        self._vertex_count = len(self.vertex)

    @property
    def vertex_count(self) -> int:
        """Vertices left."""
        return self._vertex_count

    @property
    def heirs(self) -> np.ndarray:
        """``(V,)`` for each vertex of the patch the one of the patch that it has become."""
        heir = self._heir
        while not np.array_equal(further := heir[heir], heir):
            heir = further
        return heir

    def collapse(self) -> tuple[int, int]:
        """One round: the numbers of edges that it tried and of those that it collapsed."""
        chosen = self._selected()
        if len(chosen) == 0:
            return 0, 0
        first, second = self._edges[:, chosen]
        position = best_positions(self.vertices, self.quadrics, first, second)[0]
        stars = EdgeStars(self.vertices, self.faces, self._neighbours, first, second, position)
        crease = np.minimum(self.crease[first], self.crease[second])
        stars.refuse_bad_shapes(self._normals, self._quality, self._folded, self.crease, crease)
        good = stars.good
        tracked, face = self._tracked(stars, good)
        self._cost[chosen[~good]] = np.inf
        kept = good[stars.of_face[self.face_of_point[tracked]]]
        self.face_of_point[tracked[kept]] = face[kept]
        self._commit(stars, first[good], second[good], position[:, good])
        return len(chosen), int(good.sum())

    def compact(self) -> None:
        """Forget the vertices that no face uses, so that a round costs what is left."""
        used = np.zeros(self.vertices.shape[1], bool)
        used[self.faces] = True
        renamed = np.cumsum(used) - 1
        self.faces, self._edges = renamed[self.faces], renamed[self._edges]
        self.vertices, self.quadrics = (np.compress(used, each, axis=1) for each in (self.vertices, self.quadrics))
        self.limit, self.crease = self.limit[used], self.crease[used]
        self._fixed, self.vertex = self._fixed[used], self.vertex[used]
        self._vertex_count = len(self.vertex)

    def _costs(self, edges: np.ndarray) -> np.ndarray:
        """``(E,)`` float32; infinite where the collapse is out of the question."""
        first, second = edges
        _, mean_squared, cost = best_positions(self.vertices, self.quadrics, first, second)
        limit = _MOST_RMS * np.minimum(self.limit[first], self.limit[second])
        cost[(mean_squared > limit * limit) | self._fixed[first] | self._fixed[second]] = np.inf
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
        taken = np.zeros(self.vertices.shape[1], bool)
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

    def _commit(self, stars: EdgeStars, first: np.ndarray, second: np.ndarray, position: np.ndarray) -> None:
        self.vertices[:, first] = position
        self.quadrics[:, first] += self.quadrics[:, second]
        self.limit[first] = np.minimum(self.limit[first], self.limit[second])
        self.crease[first] = np.minimum(self.crease[first], self.crease[second])
        self._heir[self.vertex[second]] = self.vertex[first]
        self._vertex_count -= len(first)
        row = np.flatnonzero(stars.good[stars.star])
        changed = stars.face[row]
        self.changed[changed] = True
        self._normals[:, changed], self._quality[changed] = stars.normals[:, row], stars.quality[row]
        self._folded[changed] = False
        self._neighbours.ravel()[stars.sides[:, row]] = stars.neighbours[:, row]
        kept = np.ones(self.faces.shape[1], bool)
        kept[stars.removed_face[stars.good[stars.removed_star]]] = False
        place = np.append(np.cumsum(kept) - 1, -1)
        self.face_of_point = place[self.face_of_point]
        renamed = np.arange(self.vertices.shape[1])
        renamed[second] = first
        # np.compress keeps rows together, indexing by a mask does not
        self.faces = renamed[np.compress(kept, self.faces, axis=1)]
        self._neighbours = place[np.compress(kept, self._neighbours, axis=1)]
        self.face, self.changed = self.face[kept], self.changed[kept]
        self._normals = np.compress(kept, self._normals, axis=1)
        self._quality, self._folded = self._quality[kept], self._folded[kept]
        moved = np.zeros(len(renamed), bool)
        moved[first] = True
        self._edges = renamed[self._edges]
        changed = moved[self._edges[0]] | moved[self._edges[1]]
        edges = _unique_edges(np.compress(changed, self._edges, axis=1), len(renamed))
        costs = self._costs(edges)
        self._edges = np.concatenate([np.compress(~changed, self._edges, axis=1), edges], axis=1)
        self._cost = np.concatenate([self._cost[~changed], costs])
        if 2 * self._vertex_count < len(renamed):
            self.compact()


def _unique_edges(edges: np.ndarray, vertex_count: int) -> np.ndarray:
    """``(2, E)`` edges, each once, without those from a vertex to itself."""
    first, second = edges
    key = np.sort((np.minimum(first, second) * vertex_count + np.maximum(first, second))[first != second])
    key = key[np.append(True, key[1:] != key[:-1])] if len(key) else key
    return np.stack([key // vertex_count, key % vertex_count])
