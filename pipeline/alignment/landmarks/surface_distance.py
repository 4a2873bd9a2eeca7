"""Whether landmarks lie on the surface: those of another mesh, or in another frame or unit, do not."""

from collections.abc import Mapping, Sequence

import numpy as np

from ...case.landmarks import Landmark
from ...errors import InputError
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
    return {
        landmark.name: surface_distance(np.array(landmark.point), mesh)
        for landmark in landmarks
        if landmark.enabled and landmark.point is not None
    }


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


def surface_distance(point: np.ndarray, mesh: TriangleMesh) -> float:
    """Distance of a point (3,) from the nearest point of a mesh, mm.

    Notes
    -----
    A triangle that holds a point at distance d has its first corner within d + its longest side at that corner; the
    nearest vertex bounds d from above. Few triangles are left, and these are measured exactly.
    """
    from_vertices = np.linalg.norm(mesh.vertices - point, axis=1)
    # a corner of a face, not any vertex: one that no face uses is no part of the surface
    corner = from_vertices[mesh.faces[:, 0]]
    a = mesh.vertices[mesh.faces[:, 0]]
    reach = np.maximum(*(np.linalg.norm(mesh.vertices[mesh.faces[:, other]] - a, axis=1) for other in (1, 2)))
    near = corner - reach <= corner.min()
    return float(_triangle_distances(point, mesh.vertices[mesh.faces[near]]).min())


def _triangle_distances(point: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """``(F,)`` distances of a point from ``(F, 3, 3)`` triangles: from the plane inside, else from the nearest side."""
    offsets = point - triangles
    sides = np.roll(triangles, -1, axis=1) - triangles
    along = np.clip((offsets * sides).sum(axis=2) / (sides**2).sum(axis=2), 0, 1)
    from_sides = np.linalg.norm(offsets - along[..., None] * sides, axis=2).min(axis=1)
    normals = np.cross(sides[:, 0], sides[:, 1])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    # on the inner side of all three, seen along the normal
    inside = (np.cross(sides, offsets) * normals[:, None]).sum(axis=2).min(axis=1) >= 0
    from_planes = np.abs((offsets[:, 0] * normals).sum(axis=1))
    return np.where(inside, from_planes, from_sides)
