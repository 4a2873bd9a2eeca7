"""Drag-a-pin: points of the surface are held at pixels, and the pose follows, from where it is."""

import numpy as np

from ...camera.pinhole import PinholeCamera
from ...errors import InputError
from ...transforms import transform_points
from ..landmarks.levenberg_marquardt import Held, fitted_poses
from ..landmarks.reprojection import Correspondences, Poses

HELD_PX_PER_DISTANCE = 0.1
HELD_PX_PER_RADIAN = 0.3
"""Pull to the present pose: what a move by the whole distance, or a turn by a radian, costs against a pin's pixels.

Slight enough that three pins reach their pixels within a hundredth of a pixel, and enough that what the pins do not
determine stays as it is.
"""


def pull_pins(
    points_model: np.ndarray,
    pixels: np.ndarray,
    camera: PinholeCamera,
    cam_from_model: np.ndarray,
    pivot_model: np.ndarray,
) -> np.ndarray:
    """The pose nearest to the present one at which each pin lies at its pixel, as well as it can.

    * One pin: shifts parallel to the image, at the pin's depth; exact.
    * Two: shifts, rolls about the view ray and changes the distance; exact unless the pins would have to coincide.
    * Three and more: all six freedoms by Levenberg-Marquardt from the present pose, never a jump to another solution.

    Pins that coincide, or lie on a line, leave what they do not determine as it is.

    Parameters
    ----------
    points_model, pixels
        ``(N, 3)`` mm and ``(N, 2)``, N >= 1: where on the surface each pin sits, and where it is to be seen.
    cam_from_model
        The present pose.
    pivot_model
        ``(3,)`` mm: what the view ray of the roll goes through, and about what a turn is the smallest move; e.g. the
        centre of the visible surface.

    Returns
    -------
    ``(4, 4)`` cam_from_model.

    Raises
    ------
    InputError
        No pin, arrays of the wrong shape or not finite, a pin or the pivot at or behind the camera.
    """
    points, clicks, pivot = _checked(points_model, pixels, cam_from_model, pivot_model)
    pairs = Correspondences.about(points, clicks, camera, pivot)
    present = Poses.of(cam_from_model[None], pivot)
    if len(pairs) == 1:
        depth = transform_points(cam_from_model, points[0])[2]
        shown = camera.project(transform_points(cam_from_model, points))[0]
        moved = cam_from_model.copy()
        moved[:2, 3] += (clicks[0] - shown) * depth / [camera.fx, camera.fy]
        return moved
    distance = float(np.linalg.norm(present.positions[0]))
    root = np.array([HELD_PX_PER_DISTANCE / distance] * 3 + [HELD_PX_PER_RADIAN] * 3)
    freedoms = _shift_roll_depth(present.positions[0]) if len(pairs) == 2 else None
    fitted, _ = fitted_poses(pairs, present, held=Held(present, root), freedoms=freedoms)
    return fitted.matrix(0, pivot)


def _shift_roll_depth(pivot_cam: np.ndarray) -> np.ndarray:
    """``(6, 4)`` the twists that two pins may use: all shifts, and the turn about the ray through the pivot."""
    freedoms = np.zeros((6, 4))
    freedoms[:3, :3] = np.eye(3)
    freedoms[3:, 3] = pivot_cam / np.linalg.norm(pivot_cam)
    return freedoms


def _checked(
    points_model: np.ndarray, pixels: np.ndarray, cam_from_model: np.ndarray, pivot_model: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    points, clicks = np.asarray(points_model, np.float64), np.asarray(pixels, np.float64)
    pivot = np.asarray(pivot_model, np.float64)
    count = len(points)
    if count == 0 or points.shape != (count, 3) or clicks.shape != (count, 2):
        raise InputError(
            f"pins: expected N points (N, 3) and as many pixels (N, 2), N from 1, found {points.shape} and "
            f"{clicks.shape}"
        )
    if not (np.isfinite(points).all() and np.isfinite(clicks).all() and np.isfinite(pivot).all()):
        raise InputError("pins: expected finite coordinates, found NaN or infinity; set the pin anew")
    depths = transform_points(cam_from_model, np.vstack([points, pivot]))[:, 2]
    if not (depths > 0).all():
        raise InputError(
            f"pins: expected the pins and the pivot in front of the camera, found one at depth {depths.min():.4g} mm; "
            "bring the surface into view first"
        )
    return points, clicks, pivot
