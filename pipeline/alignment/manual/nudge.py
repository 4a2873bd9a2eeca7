"""Small steps of a pose, in pixels of the frame whatever the lens and distance."""

from typing import Literal

import numpy as np

from ...camera.pinhole import PinholeCamera
from ...errors import InputError
from ...transforms import rigid, rotation_from_vector, transform_points, turned_about

Axis = Literal["x", "y", "depth", "pitch", "yaw", "roll"]


def nudged(
    cam_from_model: np.ndarray,
    camera: PinholeCamera,
    pivot_model: np.ndarray,
    axis: Axis,
    step_px: float,
    radius_mm: float,
) -> np.ndarray:
    """The pose after one step. A step by ``-step_px`` undoes it, unless the step was shortened.

    With z the depth of the pivot and rho = fx radius / z the radius in pixels:

    =============  ====================================================================================================
    ``x``, ``y``   shift parallel to the image: the pivot's pixel moves right or down by exactly the step
    ``depth``      shift along the ray through the pivot, whose pixel stays. A circle of this radius about the pivot,
                   parallel to the image, shrinks by exactly the step: a positive step leads away from the camera. It
                   is limited to rho / 2, so that the distance at most doubles
    ``roll``       rotation about the camera's z axis through the pivot: the circle moves along itself by exactly the
                   step, which is an angle of step / rho
    ``pitch``      rotation about the camera's x axis through the pivot by the same angle: points at this radius in
                   front of or behind the pivot move up or down by about the step
    ``yaw``        rotation about the camera's y axis by the same angle: the points move left or right
    =============  ====================================================================================================

    Rotations are right-handed about camera axes (x right, y down, z forward).

    Parameters
    ----------
    cam_from_model
        ``(4, 4)`` the current pose.
    pivot_model
        ``(3,)`` mm, in front of the camera.
    step_px
        Pixels of the frame.
    radius_mm
        Radius of the moved surface about the pivot, e.g. half the extent of its visible part.
    """
    pivot = transform_points(cam_from_model, np.asarray(pivot_model, float))
    if not pivot[2] > 0:
        raise InputError(
            f"nudge: expected the pivot in front of the camera, found it at depth {pivot[2]:.4g} mm; "
            "bring the surface into view, or choose another pivot"
        )
    if axis in ("x", "y"):
        number, focal_px = (0, camera.fx) if axis == "x" else (1, camera.fy)
        shift = np.zeros(3)
        shift[number] = step_px * pivot[2] / focal_px
        return rigid(translation=shift) @ cam_from_model
    rho_px = camera.fx * radius_mm / pivot[2]
    if axis == "depth":
        # a step beyond rho would move the surface to infinity or behind the camera
        remaining = max(rho_px - step_px, rho_px / 2)
        return rigid(translation=pivot * (rho_px / remaining - 1)) @ cam_from_model
    vector = np.zeros(3)
    vector[("pitch", "yaw", "roll").index(axis)] = step_px / rho_px
    rotation = rotation_from_vector(vector)
    return turned_about(pivot, rotation) @ cam_from_model
