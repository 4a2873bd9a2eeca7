"""Normals of a view's surface, and the whole numbers that hold them in a file."""

import numpy as np

from ..camera.pinhole import PinholeCamera
from ..errors import InputError
from ..projection.rays import MeshRays
from ..projection.z_buffer import is_within_limits, rasterise_depth
from ..surface.mesh import TriangleMesh
from ..transforms import camera_centre

NORMAL_UNIT = 32767.5
"""Codes of a normal's component per unit."""


def _shown_faces(mesh: TriangleMesh, camera: PinholeCamera, pose: np.ndarray) -> np.ndarray:
    """``(H, W)`` the face at each pixel's centre, -1 for none."""
    if is_within_limits(mesh, camera, pose):
        return rasterise_depth(mesh, camera, pose).face
    try:
        rays = MeshRays(mesh)
    except InputError:
        raise InputError(
            "normals: expected the package embreex for a view with surface behind the camera, found none; install it "
            "(pip install embreex), or do without normals"
        ) from None
    directions = camera.rays_cam(camera.pixel_grid().reshape(-1, 2)) @ pose[:3, :3]
    origins = np.broadcast_to(camera_centre(pose), directions.shape)
    return rays.first_hits(origins.astype(np.float32), directions.astype(np.float32)).face.reshape(camera.shape_hw)


def normal_codes(mask: np.ndarray, mesh: TriangleMesh, camera: PinholeCamera, cam_from_model: np.ndarray) -> np.ndarray:
    """Normals of the sides that the camera sees, as codes: n of -1..1 is (n + 1) * :data:`NORMAL_UNIT`.

    Parameters
    ----------
    mask
        ``(H, W)`` bool: where there is surface.
    mesh, camera, cam_from_model
        The surface, model frame, the intrinsics of the view and its pose (4x4, mm).
    """
    face = _shown_faces(mesh, camera, cam_from_model)
    # a pixel's centre on an edge: the renderer may meet surface where double precision does not, beside such as does
    v, u = np.nonzero(mask & (face < 0))
    around = np.pad(face, 1, constant_values=-1)
    beside = np.max([around[v + down, u + right] for down in range(3) for right in range(3)], axis=0)
    face[v, u] = beside
    towards = np.where(mesh.front_facing(camera_centre(cam_from_model)), 1.0, -1.0)[:, None]
    of_faces = _vector_codes(towards * (mesh.face_normals @ cam_from_model[:3, :3].T))
    codes = of_faces[face]
    alone = v[beside < 0], u[beside < 0]
    rays_cam = camera.rays_cam(np.stack(alone[::-1], axis=1))
    codes[alone] = _vector_codes(-rays_cam / np.linalg.norm(rays_cam, axis=1, keepdims=True))
    codes[~mask] = 0
    return codes


def _vector_codes(vectors: np.ndarray) -> np.ndarray:
    return np.rint((vectors + 1) * NORMAL_UNIT).astype(np.uint16)


def unit_vectors(codes: np.ndarray) -> np.ndarray:
    """``(H, W, 3)`` float32 normals of codes; 0 where there is no surface."""
    return np.where(codes.any(axis=2)[..., None], codes / np.float32(NORMAL_UNIT) - 1, 0).astype(np.float32)
