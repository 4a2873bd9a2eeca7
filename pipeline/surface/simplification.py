"""Simplification of a surface to a stated tolerance: few faces where it is smooth, all that it takes elsewhere.

The distance is measured, both ways, at the vertices, the midpoints of the edges and the centres of the faces of both
surfaces (:mod:`oneframe.surface.tolerance_guard`). :mod:`oneframe.surface.edge_collapse` keeps the vertices of the
original within a tenth less than the tolerance. Where the other samples find too large a distance all the same, the
original comes back and is reduced with a tighter tolerance.
"""

from collections.abc import Callable
from functools import partial

import numpy as np

from ..errors import InputError
from .mesh import TriangleMesh
from .quadrics import dot
from .reduced_surface import PASSES, ReducedSurface
from .surface_repair import repaired
from .tolerance_guard import Excess, ToleranceGuard

_OF_VERTICES = 0.9
"""Tolerance of the vertices of the original, relative to that of all samples: it spares most of what would come back,
which costs more faces."""
_TIGHTER = 0.5
"""Factor of the tolerance where the measured distance exceeds it."""
_SMALLEST_COSINES = (0.5, 0.0)
"""Between neighbouring faces that a repair makes: no fold of more than 60 degrees, or if need be 90."""
_OTHER_PASSES = 0.2
"""Share of the time that is left after a pass."""


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
    if len(mesh.faces) == 0:
        return mesh
    tolerance = np.maximum(tolerance, 1e-7 * float(np.ptp(mesh.bounds, axis=0).max()))
    report = progress or (lambda share: None)
    state = ReducedSurface(mesh, _OF_VERTICES * tolerance)
    guard = ToleranceGuard(mesh, tolerance)
    active = np.arange(len(mesh.faces))
    done = 0.0
    while len(active):
        for number in range(PASSES):
            if len(active):
                part = partial(_report_part, report, done, 1 - _OTHER_PASSES)
                active = state.reduce(active, number, part)
                done += (1 - _OTHER_PASSES) * (1 - done)
        reduced, left = _measured(guard, state)
        # whatever exceeds its tolerance becomes the original in the end; vertices of the repair have the last numbers
        vertices = np.unique(left.corners)
        vertices = vertices[vertices < state.vertex_count]
        active = state.restore(np.unique(left.points), vertices, _TIGHTER) if len(left) else active[:0]
    report(1.0)
    return reduced


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


def _measured(guard: ToleranceGuard, state: ReducedSurface) -> tuple[TriangleMesh, Excess]:
    """The reduced surface, repaired where it exceeded its tolerance, and where it still does."""
    reduced, face_of_point = state.mesh()
    limit = guard.limits(reduced, face_of_point)
    excess = guard.excess(reduced, face_of_point, limit, state.changed)
    # what comes back to the state comes back without the repair
    wrong = np.zeros(len(reduced.vertices), bool)
    wrong[excess.corners] = True
    state.settle(np.flatnonzero(wrong[reduced.faces].any(axis=1)))
    for smallest_cosine in _SMALLEST_COSINES:
        pays = True
        while pays and len(excess):
            reduced, limit, changed, count = repaired(reduced, limit, excess, smallest_cosine)
            pays = 4 * count > len(excess)
            excess = guard.excess(reduced, face_of_point, limit, changed)
    return reduced, excess


def _report_part(report: Callable[[float], None], done: float, part: float, share: float) -> None:
    report(done + part * (1 - done) * share)


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
