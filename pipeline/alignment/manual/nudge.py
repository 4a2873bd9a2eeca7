"""Small steps of a pose, as large as they look: the unit is the pixel of the frame, whatever the lens and distance."""

from typing import Literal, get_args

import numpy as np

from ...camera.pinhole import PinholeCamera
from ...errors import InputError
from ...transforms import rigid, rotation_from_vector, transform_points, turned_about

Axis = Literal["x", "y", "depth", "pitch", "yaw", "roll"]
AXES: tuple[Axis, ...] = get_args(Axis)


def nudged(
    cam_from_model: np.ndarray,
    camera: PinholeCamera,
    pivot_model: np.ndarray,
    axis: Axis,
    step_px: float,
    radius_mm: float,
) -> np.ndarray:
    """The pose after one step; a step back by ``-step_px`` returns to where it was (unless the step was shortened).

    With z the depth of the pivot and rho = fx radius / z the radius in pixels:

    =============  ====================================================================================================
    ``x``, ``y``   shift parallel to the image: the pivot's pixel moves by exactly the step, right or down
    ``depth``      along the ray through the pivot, whose pixel stays: a rim of this radius about the pivot, parallel to
                   the image, moves inwards by exactly the step; so a positive step leads away from the camera. It
                   is shortened to half of rho: the distance at most doubles
    ``roll``       about the camera's z axis through the pivot: the rim moves along itself by exactly the step
    ``pitch``      about the camera's x axis through the pivot, by the same angle, step / rho: what lies at this radius
                   before or behind the pivot moves by the step up or down
    ``yaw``        about the camera's y axis, likewise: left or right
    =============  ====================================================================================================

    Rotations are right-handed about camera axes (x right, y down, z forward).

    Parameters
    ----------
    pivot_model
        ``(3,)`` mm, in front of the camera.
    radius_mm
        Of what is moved, seen from the pivot: e.g. half the extent of the visible surface.

    Raises
    ------
    InputError
        An unknown axis, a pivot at or behind the camera, a radius that is not positive.
    """
    pivot = transform_points(cam_from_model, np.asarray(pivot_model, float))
    if axis not in AXES:
        raise InputError(f"nudge: expected one of {', '.join(AXES)}, found {axis!r}")
    if not pivot[2] > 0:
        raise InputError(
            f"nudge: expected the pivot in front of the camera, found it at depth {pivot[2]:.4g} mm; "
            "bring the surface into view, or choose another pivot"
        )
    if not radius_mm > 0:
        raise InputError(f"nudge: expected a positive radius in mm, found {radius_mm!r}")
    if axis in ("x", "y"):
        number, focal_px = (0, camera.fx) if axis == "x" else (1, camera.fy)
        shift = np.zeros(3)
        shift[number] = step_px * pivot[2] / focal_px
        return rigid(translation=shift) @ cam_from_model
    rho_px = camera.fx * radius_mm / pivot[2]
    if axis == "depth":
        # or the rim of a surface that is small in the image could shrink to nothing
        remaining = max(rho_px - step_px, rho_px / 2)
        return rigid(translation=pivot * (rho_px / remaining - 1)) @ cam_from_model
    vector = np.zeros(3)
    vector[("pitch", "yaw", "roll").index(axis)] = step_px / rho_px
    rotation = rotation_from_vector(vector)
    return turned_about(pivot, rotation) @ cam_from_model
