"""Drag-a-pin: the pose follows pins, points of the surface that the user fixes to pixels."""

import numpy as np

from ...camera.pinhole import PinholeCamera
from ...errors import InputError
from ...transforms import transform_points
from ..levenberg_marquardt import PosePrior, fit_poses
from ..reprojection import Correspondences, Poses

PRIOR_PX_PER_DISTANCE = 0.1
PRIOR_PX_PER_RADIAN = 0.3
"""Prior on the current pose: the cost, in px, of a shift by the whole distance and of a rotation by one radian.

Weak enough for three pins to reach their pixels within 0.01 px, strong enough to keep what the pins do not determine.
"""


def pull_pins(
    points_model: np.ndarray,
    pixels: np.ndarray,
    camera: PinholeCamera,
    cam_from_model: np.ndarray,
    pivot_model: np.ndarray,
) -> np.ndarray:
    """The pose nearest to the current one that brings each pin to its pixel, as far as possible.

    * One pin: a shift parallel to the image at the pin's depth; exact.
    * Two pins: a shift, a roll about the view ray and a change of distance; exact unless the pixels coincide.
    * Three and more: all six degrees of freedom by Levenberg-Marquardt from the current pose, without a jump to another
      solution.

    Pins that coincide or lie on one line do not change what they do not determine.

    Parameters
    ----------
    points_model, pixels
        ``(N, 3)`` mm and ``(N, 2)``, N >= 1: each pin's point of the surface and its target in the frame.
    camera
        Intrinsics of the undistorted frame.
    cam_from_model
        ``(4, 4)`` the current pose.
    pivot_model
        ``(3,)`` mm: the centre of rotations, e.g. the centre of the visible surface. The roll is about the ray through
        it.

    Returns
    -------
    ``(4, 4)`` the new cam_from_model.

    Raises
    ------
    InputError
        A pin or the pivot at or behind the camera.
    """
    depths = transform_points(cam_from_model, np.vstack([points_model, pivot_model]))[:, 2]
    if not (depths > 0).all():
        raise InputError(
            f"pins: expected the pins and the pivot in front of the camera, found one at depth {depths.min():.4g} mm; "
            "bring the surface into view first"
        )
    correspondences = Correspondences.about(points_model, pixels, camera, pivot_model)
    current = Poses.of(cam_from_model[None], pivot_model)
    if len(correspondences) == 1:
        shown = camera.project(transform_points(cam_from_model, points_model))[0]
        moved = cam_from_model.copy()
        moved[:2, 3] += (pixels[0] - shown) * depths[0] / [camera.fx, camera.fy]
        return moved
    distance = float(np.linalg.norm(current.positions[0]))
    root = np.array([PRIOR_PX_PER_DISTANCE / distance] * 3 + [PRIOR_PX_PER_RADIAN] * 3)
    free_directions = _shift_roll_depth(current.positions[0]) if len(correspondences) == 2 else None
    fitted, _ = fit_poses(correspondences, current, prior=PosePrior(current, root), free_directions=free_directions)
    return fitted.matrix(0, pivot_model)


def _shift_roll_depth(pivot_cam: np.ndarray) -> np.ndarray:
    """``(6, 4)`` the twists for two pins: all shifts, and the rotation about the ray through the pivot."""
    free_directions = np.zeros((6, 4))
    free_directions[:3, :3] = np.eye(3)
    free_directions[3:, 3] = pivot_cam / np.linalg.norm(pivot_cam)
    return free_directions
