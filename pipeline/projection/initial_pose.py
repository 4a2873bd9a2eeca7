"""An initial pose without prior knowledge: the surface faces the camera and fills the frame."""

import numpy as np

from ..camera.pinhole import PinholeCamera
from ..surface.mesh import Ball, TriangleMesh
from ..transforms import rigid

FILL = 0.9
"""Fraction of the frame's shorter side that the surface's bounding sphere, or the ball that matters, spans."""

OPEN = 0.1
"""How much air in one direction counts as an opening: 1 is half a sphere of it."""

HEAD, FRONT = np.array([0.0, 0.0, 1.0]), np.array([0.0, -1.0, 0.0])
"""Towards the head, and to the front, in LPS."""


def initial_pose(mesh: TriangleMesh, camera: PinholeCamera, focus: Ball | None = None) -> np.ndarray:
    """``cam_from_model`` (4x4, mm) for a surface in the model frame.

    Without a focus, the mean normal points at the camera, the first principal axis lies along the image's longer side,
    and the bounding sphere spans :data:`FILL` of the shorter side. A closed surface has no mean normal; the camera then
    looks along its last principal axis.

    With a ``focus`` (model frame, of a surface with the axes of LPS) the camera looks into it from where it is open,
    the patient's head is up, and the focus spans :data:`FILL` of the shorter side.
    """
    if focus is None:
        axes = _principal_axes(mesh)
        towards_camera = _facing(mesh, axes)
        along = _across(axes[0], towards_camera)
        if np.linalg.norm(along) < 1e-3:
            along = _across(axes[1], towards_camera)
        centre, radius = np.zeros(3), mesh.radius
    else:
        opening = opening_of(mesh, focus)
        towards_camera = _facing(mesh, _principal_axes(mesh)) if opening is None else opening
        along = np.cross(HEAD if abs(towards_camera @ HEAD) < 0.95 else FRONT, towards_camera)
        centre, radius = focus.centre, focus.radius_mm
    along /= np.linalg.norm(along)
    # the camera looks along +z: a surface that faces it has its normal along -z
    z = -towards_camera
    is_upright = focus is not None or camera.width >= camera.height
    x, y = (along, np.cross(z, along)) if is_upright else (np.cross(along, z), along)
    focal_px = min(camera.fx, camera.fy)
    half_angle = np.arctan(FILL * min(camera.size_wh) / 2 / focal_px)
    distance = radius / np.sin(half_angle)
    middle = camera.rays_cam(np.array([[(camera.width - 1) / 2, (camera.height - 1) / 2]]))[0]
    rotation = np.stack([x, y, z])
    return rigid(rotation, distance * middle / np.linalg.norm(middle) - rotation @ centre)


def opening_of(mesh: TriangleMesh, ball: Ball) -> np.ndarray | None:
    """The direction (3,), of unit length, in which most of a ball's surface lies in air; ``None`` if it lies in none.

    The area vectors of a closed surface inside a ball sum up to the integral of the outward direction over the part of
    the sphere that lies outside the surface (Gauss). A ball all in bone, or all in air, is enlarged.
    """
    corners = mesh.vertices[mesh.faces]
    distance = np.linalg.norm(corners.mean(axis=1) - ball.centre, axis=1)
    radius, farthest = ball.radius_mm, float(distance.max())
    while 0 < radius < 2 * farthest:
        area = mesh.face_cross[distance < radius].sum(axis=0) / 2
        size = float(np.linalg.norm(area))
        if size > OPEN * np.pi * radius**2:
            return area / size
        radius *= 1.25
    return None


def _principal_axes(mesh: TriangleMesh) -> np.ndarray:
    return np.linalg.svd(mesh.vertices - mesh.vertices.mean(axis=0), full_matrices=False)[2]


def _across(axis: np.ndarray, direction: np.ndarray) -> np.ndarray:
    """The part of an axis that is perpendicular to a direction of unit length."""
    return axis - direction * (axis @ direction)


def _facing(mesh: TriangleMesh, axes: np.ndarray) -> np.ndarray:
    """The mean normal (3,) of a surface, or the last of its principal axes."""
    normal = mesh.face_cross.sum(axis=0)
    area = np.linalg.norm(mesh.face_cross, axis=1).sum()
    if np.linalg.norm(normal) < 0.1 * area:
        normal = axes[2]
    return normal / np.linalg.norm(normal)
