"""Measures a reduced surface against its original, at samples all over both: vertices, midpoints of edges, centres."""

from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from functools import partial

import numpy as np

from .deviation import SurfaceTree
from .mesh import TriangleMesh
from .quadrics import dot
from .reduced_surface import ReducedSurface
from .surface_blocks import BLOCK_FACES, THREADS, grouped
from .triangle_distance import squared_triangle_distances

_BLOCK = 1 << 14
"""Points at a time, whose numbers stay in the cache."""
_CHUNK = 1 << 17
"""Faces at a time, for a thread."""


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
        # faces with samples that only a search found near enough
        self._searched = np.empty(0, np.intp)
        self._checked = False

    def exceeding(self, state: ReducedSurface) -> np.ndarray:
        """Vertices ``(N,)`` of the original where the two surfaces lie farther apart than their tolerance.

        Asked again, it measures what is :attr:`.ReducedSurface.fresh`, which it sets to ``False``.
        """
        reduced = state.mesh()
        place = np.full(len(state.alive), -1, np.int32)
        place[state.alive] = np.arange(len(reduced.faces), dtype=np.int32)
        face_of_point = place[state.face_of_point]
        fresh = state.fresh[state.alive]
        limit_of_vertex = np.full(len(reduced.vertices), np.inf)
        used = np.flatnonzero(state.face_of_point >= 0)
        for corner in reduced.faces[face_of_point[used]].T:
            np.minimum.at(limit_of_vertex, corner, self._tolerance[used])
        far = self._reduced_far(reduced, np.flatnonzero(fresh), limit_of_vertex)
        points = self._original_far(reduced, face_of_point, fresh)
        state.fresh[:] = False
        return np.concatenate([state.points_of(far), points])

    def _reduced_far(self, reduced: TriangleMesh, fresh: np.ndarray, limit_of_vertex: np.ndarray) -> np.ndarray:
        """Vertices of the reduced surface with samples on faces ``fresh`` that lie too far from the original."""
        corners = reduced.faces[fresh]
        vertices = np.unique(corners)
        samples = [(np.repeat(vertices[:, None], 3, axis=1), reduced.vertices[vertices])]
        centres = (
            reduced.vertices[corners[:, 0]] + reduced.vertices[corners[:, 1]] + reduced.vertices[corners[:, 2]]
        ) / 3
        samples.append((corners, centres))
        for start, end in ((0, 1), (1, 2), (2, 0)):
            # an edge has a face on either side, which are fresh together or not
            once = corners[:, start] < corners[:, end]
            a, b = corners[once, start], corners[once, end]
            samples.append((np.stack([a, b, b], axis=1), (reduced.vertices[a] + reduced.vertices[b]) / 2))
        corner, point = (np.concatenate(each) for each in zip(*samples, strict=True))
        limit = limit_of_vertex[corner].min(axis=1)
        beyond = np.zeros(len(point), bool)
        boxes = [block for block in grouped(self._box(point), self._boxes**3) if len(block)]

        def measure(block: np.ndarray) -> None:
            beyond[block] = self._beyond_original(point[block], limit[block])

        _each(partial(measure, box) for box in boxes)
        return np.unique(corner[beyond])

    def _beyond_original(self, points: np.ndarray, limit: np.ndarray) -> np.ndarray:
        """Whether points ``(N, 3)`` lie farther from the original than ``limit``."""
        margin = float(limit.max()) + self._longest
        lower, upper = points.min(axis=0) - margin, points.max(axis=0) + margin
        ends = np.clip((np.stack([lower, upper]) - self._lower) / self._step, 0, self._boxes - 1).astype(np.intp)
        near = [
            self._faces[(x * self._boxes + y) * self._boxes + z]
            for x in range(ends[0, 0], ends[1, 0] + 1)
            for y in range(ends[0, 1], ends[1, 1] + 1)
            for z in range(ends[0, 2], ends[1, 2] + 1)
        ]
        faces = np.concatenate([each[_within(self._first[each], lower, upper)] for each in near])
        if len(faces) == 0:
            return np.ones(len(points), bool)
        return SurfaceTree(TriangleMesh(self._mesh.vertices, self._mesh.faces[faces])).beyond(points, limit)

    def _original_far(self, reduced: TriangleMesh, face_of_point: np.ndarray, fresh: np.ndarray) -> np.ndarray:
        """Vertices of faces of the original with samples that lie too far from the reduced surface."""
        corners = [np.ascontiguousarray(reduced.vertices[reduced.faces[:, corner]].T) for corner in range(3)]
        faces = self._mesh.faces
        if self._checked:
            is_new = np.append(fresh, False)[face_of_point]
            is_due = is_new[faces[:, 0]] | is_new[faces[:, 1]] | is_new[faces[:, 2]]
            is_due[self._searched] = True
            due = np.flatnonzero(is_due)
        else:
            due = np.arange(len(faces))
        found: dict[int, list[np.ndarray]] = {}

        def measure(start: int) -> None:
            found[start] = []
            face = due[start : start + _CHUNK]
            corner = faces[face]
            vertices = [self._mesh.vertices[each] for each in corner.T]
            samples = [(np.arange(len(face)), corner.T, (vertices[0] + vertices[1] + vertices[2]) / 3)]
            for one, other in ((0, 1), (1, 2), (2, 0)):
                # the border of a surface stays: its edges need no samples
                once = np.flatnonzero(corner[:, one] < corner[:, other])
                ends = corner[once, one], corner[once, other]
                samples.append((once, np.stack(ends), (vertices[one][once] + vertices[other][once]) / 2))
            for sample, corner_of, point in samples:
                limit = self._tolerance[corner_of].min(axis=0)
                far = _beyond_faces(point, corners, face_of_point[corner_of], limit)
                if len(far):
                    found[start] += [face[sample[far]], point[far], limit[far]]

        _each(partial(measure, start) for start in range(0, len(due), _CHUNK))
        lists = [found[start] for start in sorted(found)]
        if not any(lists):
            self._searched, self._checked = np.empty(0, np.intp), True
            return np.empty(0, np.intp)
        face, point, limit = (np.concatenate([part for each in lists for part in each[turn::3]]) for turn in range(3))
        self._searched, self._checked = face, True
        beyond = SurfaceTree(reduced).beyond(point, limit)
        return np.unique(faces[face[beyond]])

    def _box(self, points: np.ndarray) -> np.ndarray:
        cell = np.clip((points - self._lower) / self._step, 0, self._boxes - 1).astype(np.int32)
        return (cell[:, 0] * self._boxes + cell[:, 1]) * self._boxes + cell[:, 2]


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
