"""A first pose for a surface that nothing is known about: facing the camera, centred, as large as the frame."""

import numpy as np

from ...camera.pinhole import PinholeCamera
from ...surface.mesh import TriangleMesh
from ...transforms import rigid

FILL = 0.9
"""Part of the frame's shorter side that the surface fills at first."""


def initial_pose(mesh: TriangleMesh, camera: PinholeCamera) -> np.ndarray:
    """``cam_from_model`` (4x4, mm) for a surface in the model frame.

    The surface's mean front side is turned to the camera, its widest extent lies along the image's longer side, and
    its bounding sphere spans :data:`FILL` of the shorter side. A closed surface has no mean front side: it is seen
    along its narrowest extent.
    """
    _, _, axes = np.linalg.svd(mesh.vertices - mesh.vertices.mean(axis=0), full_matrices=False)
    normal = mesh.face_cross.sum(axis=0)
    area = np.linalg.norm(mesh.face_cross, axis=1).sum()
    if np.linalg.norm(normal) < 0.1 * area:
        normal = axes[2]
    towards_camera = normal / np.linalg.norm(normal)
    wide = axes[0] - towards_camera * (axes[0] @ towards_camera)
    if np.linalg.norm(wide) < 1e-3:
        wide = axes[1] - towards_camera * (axes[1] @ towards_camera)
    wide /= np.linalg.norm(wide)
    # the camera looks along +z: the side turned to it has its normal along -z
    z = -towards_camera
    x, y = (wide, np.cross(z, wide)) if camera.width >= camera.height else (np.cross(wide, z), wide)
    focal_px = min(camera.fx, camera.fy)
    half_angle = np.arctan(FILL * min(camera.size_wh) / 2 / focal_px)
    distance = mesh.radius / np.sin(half_angle)
    middle = camera.rays_cam(np.array([[(camera.width - 1) / 2, (camera.height - 1) / 2]]))[0]
    return rigid(np.stack([x, y, z]), distance * middle / np.linalg.norm(middle))
