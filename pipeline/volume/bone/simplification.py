"""Simplification of a surface by the library pyfqmr, which collapses edges while the error stays small.

The error is the root of the summed squared distances from the planes around an edge (Garland & Heckbert, "Surface
simplification using quadric error metrics", 1997, as implemented by S. Forstmann). It does not bound the distance
between the two surfaces: that is measured in docs/measurements.md.
"""

import numpy as np

from ...errors import InputError
from ...surface.mesh import Ball, TriangleMesh, distinct_points

_ERROR = 2.0
"""Error that the library is allowed, in tolerances: of nearly all points the distances are below the tolerance then."""
_THRESHOLDS = 10
"""Rising limits of the error, up to the allowed one: small errors first make fewer faces do."""


def simplified(mesh: TriangleMesh, tolerance_mm: float, focus: Ball | None = None, finer: float = 1.0) -> TriangleMesh:
    """A surface of fewer faces, for which the two lie no farther apart than a tolerance nearly everywhere.

    The border of an open surface stays as it is. The same mesh gives the same bytes on the same machine.

    Parameters
    ----------
    mesh
        Any frame, mm.
    tolerance_mm
        Distance of the two surfaces.
    focus, finer
        The part, up to twice its radius, whose tolerance is so many times smaller.
    """
    if not (np.isfinite(tolerance_mm) and tolerance_mm > 0):
        raise InputError(f"tolerance: expected more than 0 mm, found {tolerance_mm:g}")
    near = np.zeros(len(mesh.faces), np.bool_)
    if focus is not None:
        near = np.linalg.norm(mesh.face_centres - focus.centre, axis=1) < 2 * focus.radius_mm
    # the edges between the two parts stay
    parts = [
        _collapsed(mesh, faces, _ERROR * tolerance)
        for faces, tolerance in ((mesh.faces[~near], tolerance_mm), (mesh.faces[near], tolerance_mm / finer))
        if len(faces)
    ]
    if not parts:
        return mesh
    count = np.cumsum([0, *(len(part.vertices) for part in parts)])
    vertices, index = distinct_points(np.concatenate([part.vertices for part in parts]))
    joined = index[np.concatenate([part.faces + begin for part, begin in zip(parts, count[:-1], strict=True)])]
    used, corners = np.unique(_without_pairs(joined), return_inverse=True)
    return TriangleMesh(vertices[used], corners.reshape(-1, 3).astype(np.int32))


def _collapsed(mesh: TriangleMesh, faces: np.ndarray, error_mm: float) -> TriangleMesh:
    """Some faces of a mesh with the edges collapsed whose error is allowed; their border stays."""
    # brought by installation and extension, and of use for a CT only
    import pyfqmr

    used, corners = np.unique(faces, return_inverse=True)
    simplifier = pyfqmr.Simplify()
    simplifier.setMesh(mesh.vertices[used], corners.reshape(-1, 3).astype(np.int32))
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
    vertices, collapsed, _ = simplifier.getMesh()
    return TriangleMesh(np.asarray(vertices, np.float64), np.asarray(collapsed, np.int32))


def _without_pairs(faces: np.ndarray) -> np.ndarray:
    """The faces ``(F, 3)`` without those that have become an edge, or lie back to back on another."""
    faces = faces[(faces != np.roll(faces, 1, axis=1)).all(axis=1)]
    corners = np.sort(faces, axis=1)
    order = np.lexsort(corners.T)
    same = (corners[order[1:]] == corners[order[:-1]]).all(axis=1)
    paired = np.zeros(len(faces), bool)
    paired[order[1:][same]] = paired[order[:-1][same]] = True
    return faces[~paired]
