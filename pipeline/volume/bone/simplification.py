"""Simplification of a surface to a stated tolerance: by a library, then measured, and mended where it went too far.

The library pyfqmr collapses edges while the sum of squared distances from the planes around them is small. That neither
bounds the distance between the two surfaces, nor keeps a thin plate, nor a closed surface closed. So both are measured,
and where something is wrong the original is reduced less, or stays as it is.

Source: Garland & Heckbert, "Surface simplification using quadric error metrics" (1997), as implemented by S. Forstmann.
"""

from collections.abc import Callable
from functools import partial

import numpy as np

from ...errors import InputError
from ...surface.deviation import SurfaceTree
from ...surface.mesh import TriangleMesh, distinct_points

_ERROR = 2.5
"""Root of the error that the library is allowed at first, in tolerances: the distances are well below it."""
_THRESHOLDS = 10
"""Rising limits of the error, up to the allowed one: small errors first make fewer faces do."""
_STEPS = 1
"""Times that the error is halved where something was wrong, before the original stays: each round takes time."""
_FIRST_ROUNDS = 4
"""After them, ever more is taken around what is wrong, so that it ends."""
_BLOCK_FACES = 1 << 19
"""Faces that are reduced at a time, which bounds the memory. Edges between blocks stay, which is of no account."""


def simplified(
    mesh: TriangleMesh, tolerance_mm: float | np.ndarray, *, progress: Callable[[float], None] | None = None
) -> TriangleMesh:
    """A surface of fewer faces within a tolerance of the original.

    What is closed stays closed, and the border of an open surface stays as it is. Holes and parts that are smaller than
    the tolerance may go. The same mesh gives the same bytes on the same machine.

    Parameters
    ----------
    mesh
        Any frame, mm.
    tolerance_mm
        Largest distance of the two surfaces, measured from vertices and centres of faces of the original, and from
        vertices, midpoints of edges and centres of faces of the result; one number or one for every vertex of the
        original ``(V,)``, as from :func:`tolerance_near`.
    progress
        Called with the share done, 0..1, after each block; it may raise to cancel.

    Raises
    ------
    InputError
        A tolerance that is not positive and finite, or not one for every vertex; or the library is not installed.
    """
    tolerance = _checked_tolerance(tolerance_mm, len(mesh.vertices))
    if len(mesh.faces) == 0:
        return mesh
    report = progress or (lambda share: None)
    largest = float(tolerance.max())
    # how often the error is halved at each vertex
    least = np.ceil(np.log2(largest / tolerance)).astype(np.intp)
    halvings, most = least, least + _STEPS
    original = _Original(mesh, tolerance)
    rounds, left = 0, 1.0
    while True:
        groups = np.where((halvings >= most)[mesh.faces].any(axis=1), -1, halvings[mesh.faces].max(axis=1))
        reduced = _reduced(mesh, groups, _ERROR * largest, partial(_report_part, report, left))
        left /= 2
        rounds += 1
        wrong = original.wrong(reduced)
        for _ in range(max(1, rounds - _FIRST_ROUNDS)):
            wrong[mesh.faces[wrong[mesh.faces].any(axis=1)]] = True
        raised = np.minimum(halvings + wrong, most)
        if (raised == halvings).all():
            report(1.0)
            return reduced
        halvings = raised


def tolerance_near(
    mesh: TriangleMesh, centre: np.ndarray, radius_mm: float, near_mm: float, far_mm: float
) -> np.ndarray:
    """``(V,)`` mm: a tolerance for each vertex that keeps detail in a ball, e.g. where the frame looks.

    The ball has its centre, (3,), in the frame of the mesh, mm. In it the tolerance is ``near_mm``, from twice its
    radius on ``far_mm``; between them it grows smoothly.
    """
    outside = np.clip(np.linalg.norm(mesh.vertices - centre, axis=1) / radius_mm - 1, 0, 1)
    return near_mm + (far_mm - near_mm) * outside * outside * (3 - 2 * outside)


class _Original:
    """The surface that others are measured against."""

    def __init__(self, mesh: TriangleMesh, tolerance: np.ndarray) -> None:
        self._mesh, self._tolerance = mesh, tolerance
        self._tree = SurfaceTree(mesh)
        self._open = np.zeros(len(mesh.vertices), bool)
        self._open[_open_vertices(mesh)] = True

    def wrong(self, reduced: TriangleMesh) -> np.ndarray:
        """``(V,)`` bool: vertices where the two lie too far apart, or an edge has not two faces as it had."""
        if len(reduced.faces) == 0:
            return np.ones(len(self._mesh.vertices), bool)
        tree = SurfaceTree(reduced)
        wrong = tree.beyond(self._mesh.vertices, self._tolerance)
        far = tree.beyond(self._mesh.face_centres, self._tolerance[self._mesh.faces].min(axis=1))
        wrong[self._mesh.faces[far]] = True
        corners = reduced.vertices[reduced.faces]
        middles = (corners + np.roll(corners, 1, axis=1)).reshape(-1, 3) / 2
        for samples in (reduced.vertices, middles, reduced.face_centres):
            # most are nearer than the smallest tolerance, which is soon told
            samples = samples[self._tree.beyond(samples, np.full(len(samples), self._tolerance.min()))]
            distance, face = self._tree.nearest(samples)
            exceeds = distance > self._tolerance[self._mesh.faces[face]].min(axis=1)
            wrong[self._mesh.faces[face[exceeds]]] = True
        _, face = self._tree.nearest(reduced.vertices[_open_vertices(reduced)])
        wrong[self._mesh.faces[face[~self._open[self._mesh.faces[face]].any(axis=1)]]] = True
        return wrong


def _reduced(mesh: TriangleMesh, groups: np.ndarray, error_mm: float, report: Callable[[float], None]) -> TriangleMesh:
    """The mesh with each group of faces reduced for itself; edges between groups stay.

    ``groups`` (F,): how often the error is halved, or -1 for faces that stay.
    """
    points, faces, count = [], [], 0
    for start in range(0, len(groups), _BLOCK_FACES):
        block, of_block = mesh.faces[start : start + _BLOCK_FACES], groups[start : start + _BLOCK_FACES]
        for halvings in np.unique(of_block):
            used, corners = np.unique(block[of_block == halvings], return_inverse=True)
            part = TriangleMesh(mesh.vertices[used], corners.reshape(-1, 3).astype(np.int32))
            if halvings >= 0:
                part = _collapsed(part, error_mm / 2.0**halvings)
            points.append(part.vertices)
            faces.append(part.faces + count)
            count += len(part.vertices)
        report(min((start + _BLOCK_FACES) / len(groups), 1.0))
    vertices, index = distinct_points(np.concatenate(points))
    joined = _without_pairs(index[np.concatenate(faces)])
    used, corners = np.unique(joined, return_inverse=True)
    return TriangleMesh(vertices[used], corners.reshape(-1, 3).astype(np.int32))


def _collapsed(mesh: TriangleMesh, error_mm: float) -> TriangleMesh:
    """The mesh with the edges collapsed whose error is allowed; its border stays."""
    try:
        import pyfqmr
    except ImportError:
        raise InputError(
            "simplification: expected the package pyfqmr in this Python, found none; install it (pip install pyfqmr), "
            "or keep all faces: --tolerance 0"
        ) from None
    simplifier = pyfqmr.Simplify()
    simplifier.setMesh(mesh.vertices, mesh.faces)
    simplifier.simplify_mesh(
        target_count=0,
        update_rate=1,
        max_iterations=_THRESHOLDS,
        # the limit of squared errors is alpha * (iteration + K) ** aggressiveness
        alpha=(error_mm**2) / _THRESHOLDS**3,
        aggressiveness=3,
        K=1,
        preserve_border=True,
        verbose=False,
    )
    vertices, faces, _ = simplifier.getMesh()
    return TriangleMesh(np.asarray(vertices, np.float64), np.asarray(faces, np.int32))


def _without_pairs(faces: np.ndarray) -> np.ndarray:
    """The faces ``(F, 3)`` without those that have become an edge, or lie back to back on another."""
    faces = faces[(faces != np.roll(faces, 1, axis=1)).all(axis=1)]
    corners = np.sort(faces, axis=1)
    order = np.lexsort(corners.T)
    same = (corners[order[1:]] == corners[order[:-1]]).all(axis=1)
    paired = np.zeros(len(faces), bool)
    paired[order[1:][same]] = paired[order[:-1][same]] = True
    return faces[~paired]


def _open_vertices(mesh: TriangleMesh) -> np.ndarray:
    """Indices of the vertices on edges that have not exactly two faces."""
    first, second = np.sort(mesh.faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1).T.astype(np.int64)
    edge, count = np.unique(first * len(mesh.vertices) + second, return_counts=True)
    return np.unique(np.divmod(edge[count != 2], len(mesh.vertices)))


def _report_part(report: Callable[[float], None], left: float, share: float) -> None:
    """Report the ``share`` of a round, which takes half of what is ``left``."""
    report(1 - left * (1 - share / 2))


def _checked_tolerance(tolerance_mm: float | np.ndarray, vertex_count: int) -> np.ndarray:
    tolerance = np.asarray(tolerance_mm, dtype=np.float64)
    if tolerance.ndim and tolerance.shape != (vertex_count,):
        raise InputError(
            f"tolerance: expected one number or one for each of {vertex_count} vertices, found shape {tolerance.shape}"
        )
    bad = ~(np.isfinite(tolerance) & (tolerance > 0))
    if bad.any():
        raise InputError(f"tolerance: expected more than 0 mm, found {float(tolerance[bad].flat[0]):g}")
    return np.broadcast_to(tolerance, (vertex_count,))
