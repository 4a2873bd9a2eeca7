"""The faces around edges before and after the edges collapse: what may happen, and how far points end up.

Source: the link condition of Dey et al., "Topology preserving edge contraction" (1999).
"""

import numpy as np

from .face_sides import smallest_cosine
from .quadrics import dot
from .triangle_distance import squared_triangle_distances
from .triangle_shape import DEGENERATE, SMALLEST_QUALITY, shapes

_BLOCK = 1 << 11
"""Points at a time, whose numbers stay in the cache."""
_SMALLEST_COSINE = 0.5
"""Between the normals of a face before and after a collapse."""


class EdgeStars:
    """The faces around edges as their collapse would leave them: *rows*, with the new vertex as first corner.

    Attributes
    ----------
    good
        ``(S,)`` bool: the collapse keeps a manifold, flips and folds no face and makes no sliver.
    of_face, row_of_face
        ``(F,)`` for each face its star and its row, -1 if none.
    face, star
        ``(R,)`` for each row its face and its star.
    normals, quality
        ``(3, R)`` unit normals of the rows, and ``(R,)`` their quality.
    sides, neighbours
        ``(3, R)`` places of the rows' sides in an array ``(3, F)`` that is raveled, and the faces beyond them.
    removed_face, removed_star
        Faces that vanish, and the stars they vanish from.
    """

    def __init__(
        self,
        vertices: np.ndarray,
        faces: np.ndarray,
        neighbours: np.ndarray,
        first: np.ndarray,
        second: np.ndarray,
        position: np.ndarray,
    ) -> None:
        count, (_, vertex_count), (_, face_count) = len(first), vertices.shape, faces.shape
        star_of_vertex = np.full(vertex_count, -1)
        star_of_vertex[first] = star_of_vertex[second] = np.arange(count)
        corner_star = star_of_vertex[faces]
        self.of_face = np.maximum(np.maximum(corner_star[0], corner_star[1]), corner_star[2])
        touched = np.flatnonzero(self.of_face >= 0)
        star, inner, corners = self.of_face[touched], corner_star[:, touched] >= 0, faces[:, touched]
        removed = (inner[0].view(np.int8) + inner[1] + inner[2]) == 2
        self.removed_face, self.removed_star = touched[removed], star[removed]
        self.face, self.star = touched[~removed], star[~removed]
        self.row_of_face = np.full(face_count, -1)
        self.row_of_face[self.face] = np.arange(len(self.face))
        apart, inner = inner[:, removed], inner[:, ~removed]
        # faces without an inner corner on the side from corner to corner + 1
        opposite = np.where(apart, 0, corners[:, removed]).sum(axis=0)
        corner = inner[1] + 2 * inner[2].astype(np.intp)
        self.sides = np.stack([(corner + turn) % 3 * face_count for turn in range(3)]) + self.face
        left, right = (faces.ravel()[self.sides[turn]] for turn in (1, 2))
        self.ring = left, right
        self._apex = np.take(position, self.star, axis=1)
        a, b = np.take(vertices, left, axis=1), np.take(vertices, right, axis=1)
        self._left, self._right = a - self._apex, b - self._apex
        self.normals, self.quality = shapes(self._left, self._right)
        self.neighbours = self._neighbours(neighbours, np.where(apart[2], np.where(apart[1], 1, 2), 0))
        self.good = self._manifold(count, opposite, left, right, vertex_count)
        self._order = np.argsort(self.star, kind="stable")
        self._size = np.bincount(self.star, minlength=count)
        self.start = np.cumsum(self._size) - self._size

    def _neighbours(self, neighbours: np.ndarray, between: np.ndarray) -> np.ndarray:
        """``(3, R)`` faces beyond the rows' sides; ``between`` is the side along the edge, of faces that vanish."""
        found = neighbours.ravel()[self.sides]
        # across a face that vanishes: its two others
        around = np.take(neighbours, self.removed_face, axis=1)
        others = np.zeros(neighbours.shape[1], np.intp)
        others[self.removed_face] = around.sum(axis=0) - around[between, np.arange(len(between))]
        for side in (0, 2):
            vanishes = self.row_of_face[found[side]] < 0
            found[side, vanishes] = others[found[side, vanishes]] - self.face[vanishes]
        # where the edge cannot collapse anyway
        found[(found < 0) | (found >= neighbours.shape[1])] = -1
        return found

    def _manifold(
        self, count: int, opposite: np.ndarray, left: np.ndarray, right: np.ndarray, vertex_count: int
    ) -> np.ndarray:
        """The link condition: the ends share two neighbours, those beside the edge, and no face between these."""
        low, high = np.full(count, vertex_count), np.full(count, -1)
        np.minimum.at(low, self.removed_star, opposite)
        np.maximum.at(high, self.removed_star, opposite)
        good = (np.bincount(self.removed_star, minlength=count) == 2) & (low != high)
        good &= np.bincount(self.star, minlength=count) >= 3
        good[self.star[(np.minimum(left, right) == low[self.star]) & (np.maximum(left, right) == high[self.star])]] = (
            False
        )
        # around a disc every vertex of the ring comes once
        ring = np.sort(self.star * vertex_count + left)
        good[ring[1:][ring[1:] == ring[:-1]] // vertex_count] = False
        return good

    def refuse_bad_shapes(
        self,
        normals: np.ndarray,
        quality: np.ndarray,
        was_folded: np.ndarray,
        crease: np.ndarray,
        crease_of_star: np.ndarray,
    ) -> None:
        """Take back :attr:`good` where a face flips, folds over its neighbour, or becomes a sliver.

        Parameters
        ----------
        normals, quality, was_folded
            ``(3, F)``, ``(F,)`` and ``(F,)`` bool of the faces before; what was folded may turn over.
        crease, crease_of_star
            ``(V,)`` and ``(S,)`` cosine of the sharpest crease of the original at vertices and at the new ones.
        """
        before, quality_before = np.take(normals, self.face, axis=1), quality[self.face]
        flipped = (dot(self.normals, before) < _SMALLEST_COSINE) & (quality_before > DEGENERATE)
        flipped &= ~was_folded[self.face]
        sliver = (self.quality < SMALLEST_QUALITY) & (self.quality <= quality_before) | (self.quality < 1e-5)
        left, right = (crease[corners] for corners in self.ring)
        of_star = crease_of_star[self.star]
        next_row = self.row_of_face[self.neighbours[0]]
        folded = dot(self.normals, np.take(self.normals, next_row, axis=1)) < smallest_cosine(np.minimum(of_star, left))
        beyond = self.neighbours[1]
        limit = np.where(beyond < 0, -2, smallest_cosine(np.minimum(np.minimum(left, right), of_star)))
        folded |= dot(self.normals, np.take(normals, beyond, axis=1)) < limit
        # the face beyond may belong to another star, whose collapse may happen or not
        row = self.row_of_face[beyond]
        folded |= (dot(self.normals, np.take(self.normals, row, axis=1)) < limit) & (row >= 0)
        self.good[self.star[flipped | sliver | folded]] = False

    def squared_distances(self, row: np.ndarray, points: np.ndarray) -> np.ndarray:
        """``(N,)`` of points ``(3, N)`` from rows ``(N,)``, mm^2."""
        offset = points - np.take(self._apex, row, axis=1)
        return squared_triangle_distances(np.take(self._left, row, axis=1), np.take(self._right, row, axis=1), offset)

    def nearest(self, star: np.ndarray, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Squared distances ``(N,)``, mm^2, of points ``(3, N)`` from all of their stars, and the nearest rows."""
        squared, row = np.empty(len(star)), np.empty(len(star), np.intp)
        for at in range(0, len(star), _BLOCK):
            block = slice(at, at + _BLOCK)
            size = self._size[star[block]]
            end = np.cumsum(size)
            point = np.repeat(np.arange(len(size)), size)
            rows = self._order[self.start[star[block]][point] + np.arange(end[-1]) - (end - size)[point]]
            found = self.squared_distances(rows, points[:, block][:, point])
            least = np.minimum.reduceat(found, end - size)
            hit = np.flatnonzero(found == least[point])[::-1]
            best = np.empty(len(size), np.intp)
            best[point[hit]] = rows[hit]
            squared[block], row[block] = least, best
        return squared, row
