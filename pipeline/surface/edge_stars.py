"""The faces around edges before and after the edges collapse: what may happen, and how far points end up.

Source: the link condition of Dey et al., "Topology preserving edge contraction" (1999).
"""

import numpy as np

from .quadrics import cross, dot
from .triangle_distance import squared_triangle_distances

_BLOCK = 1 << 11
"""Points at a time, whose numbers stay in the cache."""
_SMALLEST_COSINE = 0.5
"""Between the normals of a face before and after a collapse."""
_SMALLEST_QUALITY = 0.05
"""Of a face: 1 equilateral, 0 without area. Worse ones may only get better."""
_DEGENERATE = 1e-3
"""Quality below which a face has no normal to speak of."""


class EdgeStars:
    """The faces around edges as their collapse would leave them: *rows*, with the new vertex as first corner.

    Attributes
    ----------
    good
        ``(S,)`` bool: the collapse keeps a manifold, flips no face and makes no sliver.
    of_face, row_of_face
        ``(F,)`` for each face its star and its row, -1 if none.
    face
        ``(R,)`` for each row its face.
    removed_face, removed_star
        Faces that vanish, and the stars they vanish from.
    """

    def __init__(
        self, vertices: np.ndarray, faces: np.ndarray, first: np.ndarray, second: np.ndarray, position: np.ndarray
    ) -> None:
        count, vertex_count = len(first), vertices.shape[1]
        star_of_vertex = np.full(vertex_count, -1)
        star_of_vertex[first] = star_of_vertex[second] = np.arange(count)
        corner_star = star_of_vertex[faces]
        self.of_face = np.maximum(np.maximum(corner_star[0], corner_star[1]), corner_star[2])
        touched = np.flatnonzero(self.of_face >= 0)
        star, inner, corners = self.of_face[touched], corner_star[:, touched] >= 0, faces[:, touched]
        removed = inner.sum(axis=0) == 2
        self.removed_face, self.removed_star = touched[removed], star[removed]
        opposite = np.where(inner[:, removed], 0, corners[:, removed]).sum(axis=0)
        self.face, self.star = touched[~removed], star[~removed]
        inner, corners = inner[:, ~removed], corners[:, ~removed]
        old = np.where(inner[0], corners[0], np.where(inner[1], corners[1], corners[2]))
        left = np.where(inner[0], corners[1], np.where(inner[1], corners[2], corners[0]))
        right = np.where(inner[0], corners[2], np.where(inner[1], corners[0], corners[1]))
        self.row_of_face = np.full(faces.shape[1], -1)
        self.row_of_face[self.face] = np.arange(len(self.face))
        self._apex = np.take(position, self.star, axis=1)
        a, b = np.take(vertices, left, axis=1), np.take(vertices, right, axis=1)
        self._left, self._right = a - self._apex, b - self._apex
        self.good = self._manifold(count, opposite, left, right, vertex_count)
        self.good[self.star[self._worse(np.take(vertices, old, axis=1), a, b)]] = False
        self._order = np.argsort(self.star, kind="stable")
        self._size = np.bincount(self.star, minlength=count)
        self.start = np.cumsum(self._size) - self._size

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

    def _worse(self, old: np.ndarray, a: np.ndarray, b: np.ndarray) -> np.ndarray:
        """``(R,)`` bool: the face flips over or becomes a sliver, where its inner corner was ``old`` (3, R)."""
        normal, before = cross(self._left, self._right), cross(a - old, b - old)
        across = dot(b - a, b - a)
        squared, squared_before = dot(normal, normal), dot(before, before)
        sides = dot(self._left, self._left) + dot(self._right, self._right) + across
        sides_before = dot(a - old, a - old) + dot(b - old, b - old) + across
        quality = 12 * squared / np.maximum(sides * sides, 1e-300)
        quality_before = 12 * squared_before / np.maximum(sides_before * sides_before, 1e-300)
        along = dot(normal, before)
        flipped = (along < 0) | (along * along < _SMALLEST_COSINE**2 * squared * squared_before)
        sliver = (quality < _SMALLEST_QUALITY**2) & (quality <= quality_before) | (quality < 1e-10)
        return (flipped & (quality_before > _DEGENERATE**2)) | sliver

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
