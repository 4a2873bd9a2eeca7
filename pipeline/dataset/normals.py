"""Normals of a view's surface, and the whole numbers that hold them in a file."""

import numpy as np

from ..camera.pinhole import PinholeCamera
from ..projection.z_buffer import rasterise_depth
from ..surface.mesh import TriangleMesh
from ..transforms import camera_centre

NORMAL_UNIT = 32767.5
"""Codes of a normal's component per unit."""


def normal_codes(mask: np.ndarray, mesh: TriangleMesh, camera: PinholeCamera, cam_from_model: np.ndarray) -> np.ndarray:
    """Normals of the sides that the camera sees, as codes: n of -1..1 is (n + 1) * :data:`NORMAL_UNIT`.

    Parameters
    ----------
    mask
        ``(H, W)`` bool: where there is surface.
    mesh, camera, cam_from_model
        The surface, model frame, the intrinsics of the view and its pose (4x4, mm).
    """
    face = rasterise_depth(mesh, camera, cam_from_model).face
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
