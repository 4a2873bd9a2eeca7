"""Simplification of a surface to a stated tolerance: few faces where it is smooth, all that it takes elsewhere.

The distance is measured, both ways, at the vertices, the midpoints of the edges and the centres of the faces of both
surfaces. :mod:`pipeline.surface.edge_collapse` keeps the vertices of the original within tolerance by construction.
Where the other samples find too large a distance, the original comes back and is reduced with a tighter tolerance.
"""

from collections.abc import Callable
from itertools import count

import numpy as np

from ..errors import InputError
from .deviation import SurfaceTree
from .edge_collapse import EdgeCollapse
from .mesh import TriangleMesh
from .quadrics import dot
from .triangle_distance import squared_triangle_distances

_TIGHTER = 0.5
"""Factor of the tolerance where the measured distance exceeds it."""
_LEAST_PROGRESS = 0.002
"""Share of the vertices that a round must remove; the rest would take as long as all before for 1 % of the faces."""
_USUAL_ROUNDS = 60
_BLOCK = 1 << 16


def simplified(
    mesh: TriangleMesh, tolerance_mm: float | np.ndarray, *, progress: Callable[[float], None] | None = None
) -> TriangleMesh:
    """A surface of fewer faces within a tolerance of the original, by edge collapses.

    A closed surface stays closed and keeps its topology, also the number of its parts; borders of an open one and
    edges of three or more faces stay as they are. The same mesh gives the same bytes on every machine.

    Parameters
    ----------
    mesh
        Any frame, mm.
    tolerance_mm
        Largest distance between the two surfaces, either way; one number or one for every vertex ``(V,)``, as from
        :func:`tolerance_near`. 0 merges what lies in a plane exactly.
    progress
        Called with the share done, 0..1, after each round; it may raise to cancel.

    Raises
    ------
    InputError
        A tolerance that is negative or not finite, or not one for every vertex.

    Notes
    -----
    Distances below 1e-7 of the extent count as 0. Measured at samples: between them the surfaces may lie farther apart
    by a small part of the tolerance.
    """
    tolerance = _checked_tolerance(tolerance_mm, len(mesh.vertices))
    report = progress or (lambda share: None)
    guard = _Guard(mesh, tolerance)
    state = EdgeCollapse(mesh, tolerance)
    rounds = count(1)
    while True:
        while _pays(state):
            report(min(next(rounds) / _USUAL_ROUNDS, 0.95))
        reduced = state.mesh
        vertices, points = guard.exceeding(reduced, state)
        if len(vertices) == 0 and len(points) == 0:
            report(1.0)
            return reduced
        state.fresh[:] = False
        state.restore(vertices, points, _TIGHTER)


def tolerance_near(
    mesh: TriangleMesh, centre: np.ndarray, radius_mm: float, near_mm: float, far_mm: float
) -> np.ndarray:
    """A tolerance for each vertex that keeps detail in a ball, e.g. where the frame looks.

    Parameters
    ----------
    mesh
        The surface.
    centre, radius_mm
        The ball: (3,) in the frame of the mesh, mm.
    near_mm, far_mm
        Tolerances in the ball, and from twice its radius on; between them it grows smoothly.

    Returns
    -------
    ``(V,)`` mm.

    Raises
    ------
    InputError
        A radius that is not positive, or a tolerance that is negative or not finite.
    """
    if not (np.isfinite(radius_mm) and radius_mm > 0):
        raise InputError(f"radius: expected a positive length in mm, found {radius_mm:g}")
    for name, value in (("near", near_mm), ("far", far_mm)):
        if not (np.isfinite(value) and value >= 0):
            raise InputError(f"tolerance ({name}): expected 0 mm or more, found {value:g}")
    offset = mesh.vertices.T - np.reshape(centre, (3, 1))
    outside = np.clip(np.sqrt(dot(offset, offset)) / radius_mm - 1, 0, 1)
    return near_mm + (far_mm - near_mm) * outside * outside * (3 - 2 * outside)


def _checked_tolerance(tolerance_mm: float | np.ndarray, vertex_count: int) -> np.ndarray:
    tolerance = np.asarray(tolerance_mm, dtype=np.float64)
    if tolerance.ndim and tolerance.shape != (vertex_count,):
        raise InputError(
            f"tolerance: expected one number or one for each of {vertex_count} vertices, found shape {tolerance.shape}"
        )
    bad = ~(np.isfinite(tolerance) & (tolerance >= 0))
    if bad.any():
        raise InputError(f"tolerance: expected 0 mm or more, found {float(tolerance[bad].flat[0]):g}")
    return np.broadcast_to(tolerance, (vertex_count,)).copy()


def _pays(state: EdgeCollapse) -> bool:
    """Do a round of collapses; whether another one pays."""
    before = state.vertex_count
    tried, removed = state.collapse()
    return tried > 0 and (removed >= tried / 3 or removed + 1 >= _LEAST_PROGRESS * before)


class _Guard:
    """Measures a reduced surface against the original."""

    def __init__(self, mesh: TriangleMesh, tolerance: np.ndarray) -> None:
        self._mesh, self._tolerance = mesh, np.maximum(tolerance, 1e-7 * float(np.ptp(mesh.bounds, axis=0).max()))
        self._tree = SurfaceTree(mesh)

    def exceeding(self, reduced: TriangleMesh, state: EdgeCollapse) -> tuple[np.ndarray, np.ndarray]:
        """Vertices of the reduced surface where it lies too far from the original, and of the original the converse."""
        return self._reduced_exceeding(reduced, state), self._original_exceeding(reduced, state)

    def _original_exceeding(self, reduced: TriangleMesh, state: EdgeCollapse) -> np.ndarray:
        found = [np.empty(0, np.intp)]
        tree = None
        for corners, points in _samples(self._mesh, np.arange(len(self._mesh.faces))):
            limit = self._tolerance[corners].min(axis=0)
            # the faces that track the corners are nearly always near enough
            far = _beyond(points, reduced, state.face_of_point[corners], limit)
            if len(far) == 0:
                continue
            tree = tree or SurfaceTree(reduced)
            exceeds = tree.distances(points[far]) > limit[far]
            found.append(corners[:, far[exceeds]].ravel())
        return np.concatenate(found)

    def _reduced_exceeding(self, reduced: TriangleMesh, state: EdgeCollapse) -> np.ndarray:
        corners_of_point = reduced.faces[state.face_of_point].T
        limit_of_vertex = np.full(len(reduced.vertices), np.inf)
        np.minimum.at(limit_of_vertex, corners_of_point, np.broadcast_to(self._tolerance, corners_of_point.shape))
        fresh = np.flatnonzero(state.fresh)
        far = np.zeros(len(reduced.vertices), bool)
        used = np.unique(reduced.faces[fresh])
        for corners, points in [(used[None], reduced.vertices[used]), *_samples(reduced, fresh)]:
            limit = limit_of_vertex[corners].min(axis=0)
            exceeds = self._tree.distances(points) > limit
            far[corners[:, exceeds]] = True
        return np.flatnonzero(far)


def _samples(mesh: TriangleMesh, faces: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]]:
    """Centres and midpoints of sides of ``faces`` (N,): the indices of corners ``(3 or 2, S)``, points ``(S, 3)``."""
    corners = mesh.faces[faces].T
    start, end = corners.ravel(), corners[[1, 2, 0]].ravel()
    key = np.sort(np.minimum(start, end).astype(np.int64) * len(mesh.vertices) + np.maximum(start, end))
    key = key[np.append(True, key[1:] != key[:-1])] if len(key) else key
    edges = np.stack([key // len(mesh.vertices), key % len(mesh.vertices)])
    return [(corners, mesh.face_centres[faces]), (edges, (mesh.vertices[edges[0]] + mesh.vertices[edges[1]]) / 2)]


def _beyond(points: np.ndarray, mesh: TriangleMesh, faces: np.ndarray, limit: np.ndarray) -> np.ndarray:
    """Indices of points ``(N, 3)`` farther than ``limit`` (N,) from each of ``faces`` (K, N) of the mesh."""
    a, b, c = (np.ascontiguousarray(mesh.vertices[mesh.faces[:, corner]].T) for corner in range(3))
    left = np.arange(len(points))
    for face in faces:
        still = []
        for at in range(0, len(left), _BLOCK):
            block = left[at : at + _BLOCK]
            corner = face[block]
            start = np.take(a, corner, axis=1)
            first, second = np.take(b, corner, axis=1) - start, np.take(c, corner, axis=1) - start
            squared = squared_triangle_distances(first, second, points[block].T - start)
            still.append(block[squared > limit[block] ** 2])
        left = np.concatenate(still) if still else left
    return left
