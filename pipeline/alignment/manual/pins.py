"""Drag-a-pin: the pose follows pins, points of the surface that the user fixes to pixels."""

import numpy as np

from ...camera.pinhole import PinholeCamera
from ...errors import InputError
from ...transforms import rigid, rotation_from_vector, transform_points
from ..levenberg_marquardt import PosePrior, fit_poses
from ..reprojection import Correspondences, Poses

PRIOR_PX_PER_DISTANCE = 0.1
PRIOR_PX_PER_RADIAN = 0.3
"""Prior on the current pose: the cost, in px, of a shift by the whole distance and of a rotation by one radian.

Weak enough for three pins to reach their pixels within 0.01 px, strong enough to keep what the pins do not determine.
"""

MAX_DISTANCE_RATIO = 4.0
"""One drag brings the surface at most this many times nearer or farther: pixels that nearly coincide would send it to
infinity."""

HELD_COUNTS = 100
"""As many pins does the one in the hand count for."""


def pull_pins(
    points_model: np.ndarray,
    pixels: np.ndarray,
    camera: PinholeCamera,
    cam_from_model: np.ndarray,
    pivot_model: np.ndarray,
    *,
    held: int | None = None,
    radius_mm: float = 0.0,
) -> np.ndarray:
    """``(4, 4)`` the pose nearest to the current one that brings each pin to its pixel, as far as possible.

    * One pin: a shift parallel to the image at the pin's depth; exact.
    * Two pins: a shift, a roll about the view ray and a change of distance; exact unless the pixels coincide.
    * Three and more: all six degrees of freedom.

    The last two by Levenberg-Marquardt, from the current pose and from the shift, roll and distance that fit the pins
    best: a surface upside down has no way back from the current pose. Pins that coincide or lie on one line do not
    change what they do not determine. None brings the surface more than :data:`MAX_DISTANCE_RATIO` times nearer or
    farther, nor its ball of ``radius_mm`` to the camera.

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
    held
        The pin in the hand: where pins contradict each other, it wins, and it is always where it is wanted.
    radius_mm
        Radius of a ball about the pivot that holds the surface.
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
        return _shifted(cam_from_model, points_model[0], pixels[0], camera)
    distance = float(np.linalg.norm(current.positions[0]))
    root = np.diag([PRIOR_PX_PER_DISTANCE / distance] * 3 + [PRIOR_PX_PER_RADIAN] * 3)
    free_directions = _shift_roll_depth(current.positions[0]) if len(correspondences) == 2 else None
    ratios = max(1 / MAX_DISTANCE_RATIO, min(radius_mm / depths[-1], 1.0)), MAX_DISTANCE_RATIO
    in_plane = _shifted_rolled_and_scaled(points_model, pixels, camera, cam_from_model, current.positions[0], ratios)
    starts = Poses.of(np.stack([cam_from_model, in_plane]), pivot_model)
    counted = [*range(len(points_model)), *([] if held is None else [held] * HELD_COUNTS)]
    prior = PosePrior(current, root)
    fitted, cost = fit_poses(correspondences[counted], starts, prior=prior, free_directions=free_directions)
    farther = fitted.positions[:, 2] / current.positions[0, 2]
    cost = np.where((farther < ratios[0]) | (farther > ratios[1]), np.inf, cost)
    pulled = in_plane
    if np.isfinite(cost).any():
        pulled = fitted.matrix(int(np.argmin(cost)), pivot_model)
    elif not (transform_points(in_plane, points_model)[:, 2] > 0).all():
        pulled = cam_from_model
    return pulled if held is None else _shifted(pulled, points_model[held], pixels[held], camera)


def _shifted(cam_from_model: np.ndarray, point: np.ndarray, pixel: np.ndarray, camera: PinholeCamera) -> np.ndarray:
    """The pose shifted parallel to the image until a point is at its pixel."""
    at = transform_points(cam_from_model, point)
    moved = cam_from_model.copy()
    moved[:2, 3] += (pixel - camera.project(at[None])[0]) * at[2] / [camera.fx, camera.fy]
    return moved


def _shifted_rolled_and_scaled(
    points: np.ndarray,
    pixels: np.ndarray,
    camera: PinholeCamera,
    cam_from_model: np.ndarray,
    pivot_cam: np.ndarray,
    ratios: tuple[float, float],
) -> np.ndarray:
    """The pose ``(4, 4)`` after the similarity of the image plane that takes the pins to their pixels best.

    Umeyama's closed form (1991) in two dimensions; the roll is about the ray through the pivot. ``ratios`` are how many
    times farther it may be at least and at most.
    """
    points_cam = transform_points(cam_from_model, points)
    shown, wanted = (rays[:, :2] @ [1, 1j] for rays in (points_cam / points_cam[:, 2:], camera.rays_cam(pixels)))
    spread = shown - shown.mean()
    turn = (spread.conj() @ (wanted - wanted.mean())) / max(np.vdot(spread, spread).real, 1e-300) or 1.0
    moved = (
        rigid(rotation_from_vector(np.angle(turn) * pivot_cam / np.linalg.norm(pivot_cam)), np.zeros(3))
        @ cam_from_model
    )
    farther = np.clip(1 / max(abs(turn), 1e-300), *ratios)
    moved[2, 3] += pivot_cam[2] * (farther - 1)
    moved_cam = transform_points(moved, points)
    shift = (wanted * moved_cam[:, 2] - moved_cam[:, :2] @ [1, 1j]).mean()
    moved[:2, 3] += [shift.real, shift.imag]
    return moved


def _shift_roll_depth(pivot_cam: np.ndarray) -> np.ndarray:
    """``(6, 4)`` the twists for two pins: all shifts, and the rotation about the ray through the pivot."""
    free_directions = np.zeros((6, 4))
    free_directions[:3, :3] = np.eye(3)
    free_directions[3:, 3] = pivot_cam / np.linalg.norm(pivot_cam)
    return free_directions
