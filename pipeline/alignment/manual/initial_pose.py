"""An initial pose without prior knowledge: the surface faces the camera, centred, and fills the frame."""

import numpy as np

from ...camera.pinhole import PinholeCamera
from ...surface.mesh import TriangleMesh
from ...transforms import rigid

FILL = 0.9
"""Fraction of the frame's shorter side that the surface's bounding sphere spans."""


def initial_pose(mesh: TriangleMesh, camera: PinholeCamera) -> np.ndarray:
    """``cam_from_model`` (4x4, mm) for a surface in the model frame.

    The mean normal points at the camera, the first principal axis lies along the image's longer side, and the bounding
    sphere spans :data:`FILL` of the shorter side. A closed surface has no mean normal; the camera then looks along its
    last principal axis.
    """
    _, _, axes = np.linalg.svd(mesh.vertices - mesh.vertices.mean(axis=0), full_matrices=False)
    normal = mesh.face_cross.sum(axis=0)
    area = np.linalg.norm(mesh.face_cross, axis=1).sum()
    if np.linalg.norm(normal) < 0.1 * area:
        normal = axes[2]
    towards_camera = normal / np.linalg.norm(normal)
    long_axis = axes[0] - towards_camera * (axes[0] @ towards_camera)
    if np.linalg.norm(long_axis) < 1e-3:
        long_axis = axes[1] - towards_camera * (axes[1] @ towards_camera)
    long_axis /= np.linalg.norm(long_axis)
    # the camera looks along +z: a surface that faces it has its normal along -z
    z = -towards_camera
    x, y = (long_axis, np.cross(z, long_axis)) if camera.width >= camera.height else (np.cross(long_axis, z), long_axis)
    focal_px = min(camera.fx, camera.fy)
    half_angle = np.arctan(FILL * min(camera.size_wh) / 2 / focal_px)
    distance = mesh.radius / np.sin(half_angle)
    middle = camera.rays_cam(np.array([[(camera.width - 1) / 2, (camera.height - 1) / 2]]))[0]
    return rigid(np.stack([x, y, z]), distance * middle / np.linalg.norm(middle))
