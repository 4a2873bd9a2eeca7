"""Measures a reduced surface against its original, at samples all over both: vertices, midpoints of edges, centres."""

from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial

import numpy as np

from .deviation import SurfaceTree
from .mesh import TriangleMesh
from .quadrics import dot
from .surface_blocks import BLOCK_FACES, THREADS, grouped
from .triangle_distance import nearest_weights, squared_triangle_distances

_BLOCK = 1 << 14
"""Points at a time, whose numbers stay in the cache."""
_CHUNK = 1 << 17
"""Faces at a time, for a thread."""
_ON_SIDE = 0.15
"""Barycentric coordinate below which a place counts as one on the opposite side."""


@dataclass(frozen=True)
class Excess:
    """Samples at which the surfaces lie too far apart.

    Attributes
    ----------
    corners
        ``(N, 3)`` vertices of the reduced surface: a face, an edge as ``a, b, b``, or a vertex as ``a, a, a``.
    base, target
        ``(N, 3)`` a point in there, mm, and where the original is.
    points
        ``(N, 3)`` vertices of the original: of its nearest face.
    """

    corners: np.ndarray
    base: np.ndarray
    target: np.ndarray
    points: np.ndarray

    def __len__(self) -> int:
        return len(self.corners)


_NONE = (np.empty((0, 3), np.intp), np.empty((0, 3)), np.empty((0, 3)), np.empty((0, 3), np.intp))


class ToleranceGuard:
    """The original with the tolerances of its vertices."""

    def __init__(self, mesh: TriangleMesh, tolerance_mm: np.ndarray) -> None:
        """Take the original, and ``(V,)`` tolerances, mm."""
        self._mesh, self._tolerance = mesh, tolerance_mm
        self._first = mesh.vertices[mesh.faces[:, 0]]
        count = max(round((len(mesh.faces) / BLOCK_FACES) ** (1 / 3)), 1)
        self._boxes = count
        self._lower = mesh.bounds[0]
        self._step = np.maximum(np.ptp(mesh.bounds, axis=0), 1e-300) / count
        self._faces = grouped(self._box(self._first), count**3)
        self._longest = _longest_side(mesh)
        # vertices beside samples that only a search found near enough
        self._searched = np.empty(0, np.intp)

    def limits(self, reduced: TriangleMesh, face_of_point: np.ndarray) -> np.ndarray:
        """``(V,)`` tolerances of the reduced vertices: the least of what their faces stand for, mm.

        Parameters
        ----------
        face_of_point
            For each vertex of the original the reduced face that stands for it, -1 if none.
        """
        limit = np.full(len(reduced.vertices), np.inf)
        used = np.flatnonzero(face_of_point >= 0)
        for corner in reduced.faces[face_of_point[used]].T:
            np.minimum.at(limit, corner, self._tolerance[used])
        return limit

    def excess(
        self, reduced: TriangleMesh, face_of_point: np.ndarray, limit: np.ndarray, changed: np.ndarray
    ) -> Excess:
        """Measure where the two surfaces lie farther apart than their tolerance.

        Parameters
        ----------
        face_of_point, limit
            Those of :meth:`limits`.
        changed
            ``(N,)`` faces of the reduced surface that have changed since it was last measured.
        """
        of_reduced = self._reduced_excess(reduced, changed, limit)
        of_original = self._original_excess(reduced, face_of_point, changed)
        return Excess(*(np.concatenate(parts) for parts in zip(of_reduced, of_original, strict=True)))

    def _reduced_excess(self, reduced: TriangleMesh, faces: np.ndarray, limit: np.ndarray) -> tuple[np.ndarray, ...]:
        """What :class:`Excess` holds, of samples on ``faces`` of the reduced surface."""
        corners = reduced.faces[faces]
        a, b, c = (reduced.vertices[corner] for corner in corners.T)
        vertices = np.unique(corners)
        samples = [(np.repeat(vertices[:, None], 3, axis=1), reduced.vertices[vertices]), (corners, (a + b + c) / 3)]
        for start, end in ((0, 1), (1, 2), (2, 0)):
            # once for the two faces beside it; both are here, or the edge is as it was
            once = corners[:, start] < corners[:, end]
            one, other = corners[once, start], corners[once, end]
            samples.append((np.stack([one, other, other], 1), (reduced.vertices[one] + reduced.vertices[other]) / 2))
        corner, point = (np.concatenate(each) for each in zip(*samples, strict=True))
        least = limit[corner].min(axis=1)
        far: dict[int, tuple[np.ndarray, np.ndarray]] = {}

        def measure(samples: np.ndarray) -> None:
            faces = self._faces_near(point[samples], least[samples])
            tree = SurfaceTree(TriangleMesh(self._mesh.vertices, self._mesh.faces[faces]))
            beyond = samples[tree.beyond(point[samples], least[samples])]
            if len(beyond):
                far[int(samples[0])] = beyond, faces[tree.nearest(point[beyond])[1]]

        # few samples lie in small groups, which need few faces of the original
        finer = 8 if len(point) < len(self._mesh.faces) / 64 else 1
        boxes, box = np.unique(self._box(point, finer), return_inverse=True)
        _each(partial(measure, samples) for samples in grouped(box.reshape(-1), len(boxes)))
        if not far:
            return _NONE
        sample, near = (np.concatenate(each) for each in zip(*(far[first] for first in sorted(far)), strict=True))
        target = _nearest_points(point[sample], self._mesh, near)[0]
        return corner[sample], point[sample], target, self._mesh.faces[near]

    def _faces_near(self, points: np.ndarray, limit: np.ndarray) -> np.ndarray:
        """Faces of the original, all that lie within ``limit`` of points ``(N, 3)``; at least one."""
        margin = float(np.where(np.isfinite(limit), limit, 0).max()) + self._longest
        lower, upper = points.min(axis=0) - margin, points.max(axis=0) + margin
        ends = np.clip((np.stack([lower, upper]) - self._lower) / self._step, 0, self._boxes - 1).astype(np.intp)
        near = [
            self._faces[(x * self._boxes + y) * self._boxes + z]
            for x in range(ends[0, 0], ends[1, 0] + 1)
            for y in range(ends[0, 1], ends[1, 1] + 1)
            for z in range(ends[0, 2], ends[1, 2] + 1)
        ]
        faces = np.concatenate([each[_within(self._first[each], lower, upper)] for each in near])
        return faces if len(faces) else np.zeros(1, np.intp)

    def _original_excess(
        self, reduced: TriangleMesh, face_of_point: np.ndarray, changed: np.ndarray
    ) -> tuple[np.ndarray, ...]:
        """What :class:`Excess` holds, of samples on the original."""
        corners = [np.ascontiguousarray(reduced.vertices[corner].T) for corner in reduced.faces.T]
        faces = self._mesh.faces
        is_changed = np.zeros(len(reduced.faces), bool)
        is_changed[changed] = True
        # vertices that no face uses have none
        is_changed = np.append(is_changed, False)[face_of_point]
        is_changed[self._searched] = True
        is_due = is_changed[faces[:, 0]] | is_changed[faces[:, 1]] | is_changed[faces[:, 2]]
        due = np.flatnonzero(is_due)
        vertices = np.flatnonzero(is_changed)
        found: dict[int, list[tuple[np.ndarray, np.ndarray, np.ndarray]]] = {}

        def measure(start: int) -> None:
            face = due[start : start + _CHUNK]
            corner = faces[face]
            a, b, c = (self._mesh.vertices[each] for each in corner.T)
            samples = [(corner.T, corner, (a + b + c) / 3)]
            for one, other, first, second in ((0, 1, a, b), (1, 2, b, c), (2, 0, c, a)):
                # the border of a surface stays: its edges need no samples
                once = np.flatnonzero(corner[:, one] < corner[:, other])
                ends = np.stack([corner[once, one], corner[once, other]])
                samples.append((ends, corner[once], (first[once] + second[once]) / 2))
            own = vertices[start : start + _CHUNK]
            samples.append((own[None], np.repeat(own[:, None], 3, axis=1), self._mesh.vertices[own]))
            found[start] = []
            for corner_of, around, point in samples:
                limit = self._tolerance[corner_of].min(axis=0)
                far = _beyond_faces(point, corners, face_of_point[corner_of], limit)
                if len(far):
                    found[start].append((around[far], point[far], limit[far]))

        _each(partial(measure, start) for start in range(0, max(len(due), len(vertices)), _CHUNK))
        far = [part for start in sorted(found) for part in found[start]]
        if not far:
            self._searched = np.empty(0, np.intp)
            return _NONE
        around, point, limit = (np.concatenate(parts) for parts in zip(*far, strict=True))
        self._searched = np.unique(around)
        tree = SurfaceTree(reduced)
        exceeds = tree.beyond(point, limit)
        if not exceeds.any():
            return _NONE
        point, around = point[exceeds], around[exceeds]
        near = tree.nearest(point)[1]
        base, weight = _nearest_points(point, reduced, near)
        return _on(reduced.faces[near], weight), base, point, around

    def _box(self, points: np.ndarray, finer: int = 1) -> np.ndarray:
        count = finer * self._boxes
        cell = np.clip((points - self._lower) * (finer / self._step), 0, count - 1).astype(np.int32)
        return (cell[:, 0] * count + cell[:, 1]) * count + cell[:, 2]


def _each(measurements: Iterable[Callable[[], None]]) -> None:
    """Take measurements, several at a time."""
    with ThreadPoolExecutor(THREADS) as threads:
        for future in [threads.submit(measurement) for measurement in measurements]:
            future.result()


def _longest_side(mesh: TriangleMesh) -> float:
    longest = 0.0
    for at in range(0, len(mesh.faces), _CHUNK):
        a, b, c = (mesh.vertices[corner].T for corner in mesh.faces[at : at + _CHUNK].T)
        longest = max(longest, *(float(dot(side, side).max()) for side in (b - a, c - b, a - c)))
    return float(np.sqrt(longest))


def _within(points: np.ndarray, lower: np.ndarray, upper: np.ndarray) -> np.ndarray:
    """``(N,)`` bool: points ``(N, 3)`` in a box."""
    inside = np.ones(len(points), bool)
    for axis in range(3):
        inside &= (points[:, axis] >= lower[axis]) & (points[:, axis] <= upper[axis])
    return inside


def _beyond_faces(points: np.ndarray, corners: list[np.ndarray], faces: np.ndarray, limit: np.ndarray) -> np.ndarray:
    """Indices of points ``(N, 3)`` farther than ``limit`` (N,) from each of ``faces`` (K, N) with ``corners``."""
    left = np.arange(len(points))
    for face in faces:
        still = []
        for at in range(0, len(left), _BLOCK):
            block = left[at : at + _BLOCK]
            corner = face[block]
            start, first, second = (np.take(each, corner, axis=1) for each in corners)
            squared = squared_triangle_distances(first - start, second - start, points[block].T - start)
            still.append(block[squared > limit[block] ** 2])
        left = np.concatenate(still) if still else left
    return left


def _nearest_points(points: np.ndarray, mesh: TriangleMesh, faces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Nearest points ``(N, 3)`` on ``faces`` (N,) to points ``(N, 3)``, and their weights ``(3, N)`` of the corners."""
    a, b, c = (mesh.vertices[corner].T for corner in mesh.faces[faces].T)
    weight = nearest_weights(b - a, c - a, points.T - a)
    return (weight[0] * a + weight[1] * b + weight[2] * c).T, weight


def _on(corners: np.ndarray, weight: np.ndarray) -> np.ndarray:
    """``(N, 3)`` the vertex, edge or face, as in :class:`Excess`, near the places ``weight`` (3, N) in faces."""
    rank = np.argsort(-weight, axis=0, kind="stable")
    ordered = np.take_along_axis(weight, rank, axis=0)
    index = np.arange(len(corners))
    first, second, third = (corners[index, each] for each in rank)
    on_edge, on_vertex = ordered[2] < _ON_SIDE, ordered[1] < _ON_SIDE
    second, third = np.where(on_vertex, first, second), np.where(on_vertex, first, np.where(on_edge, second, third))
    return np.stack([first, second, third], axis=1)
