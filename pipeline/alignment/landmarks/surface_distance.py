"""Whether landmarks lie on the surface: those of another mesh, or in another frame or unit, do not."""

from collections.abc import Mapping, Sequence

import numpy as np

from ...case.landmarks import Landmark
from ...errors import InputError
from ...surface.deviation import deviation
from ...surface.mesh import TriangleMesh

OFF_SURFACE_MM = 0.5
"""A landmark farther from the surface is reported: of the order of a voxel of a CT."""
ELSEWHERE = 0.03
"""If all landmarks lie farther from the surface than this part of its diagonal, they belong to something else."""


def landmark_distances(landmarks: Sequence[Landmark], mesh: TriangleMesh) -> dict[str, float]:
    """Name -> distance from the surface, mm, of the landmarks that are enabled and have a point.

    Parameters
    ----------
    landmarks
        In the frame of ``mesh``, mm.
    mesh
        The surface, mm.
    """
    points = {each.name: each.point for each in landmarks if each.enabled and each.point is not None}
    return dict(zip(points, deviation(np.array([*points.values()]).reshape(-1, 3), mesh).tolist(), strict=True))


def off_surface(distances: Mapping[str, float]) -> tuple[str, ...]:
    """A warning that names the landmarks off the surface, or nothing, from :func:`landmark_distances`."""
    off = [f"{name!r} ({distance:.1f} mm)" for name, distance in distances.items() if distance > OFF_SURFACE_MM]
    if not off:
        return ()
    return (f"landmarks off the surface: {', '.join(off)}; check the mesh they were picked on, its frame and its unit",)


def check_landmarks_belong(distances: Mapping[str, float], mesh: TriangleMesh, name: str) -> None:
    """Refuse landmarks that all lie far from the surface called ``name``, by their :func:`landmark_distances` from it.

    Raises
    ------
    InputError
        They do: no pose that they give could be that of this surface.
    """
    nearest = min(distances.values(), default=0.0)
    if nearest > ELSEWHERE * float(np.linalg.norm(np.ptp(mesh.bounds, axis=0))):
        raise InputError(
            f"landmarks: expected points on {name}, all lie beside it, {nearest:.3g} mm and more off; were they picked "
            "on this mesh, in this frame and unit?"
        )
