"""Where on the surface the next landmark gains most."""

from collections.abc import Sequence

import numpy as np

from ...camera.pinhole import PinholeCamera
from ...case.landmarks import Landmark
from ...transforms import transform_points
from ..landmarks.align_landmarks import complete_landmarks, landmark_arrays
from ..pose_uncertainty import PoseMode, PoseUncertainty
from ..reprojection import jacobian_at

ROUGH_DEG, ROUGH_RELATIVE_DEPTH = 10.0, 0.1
"""How far off a rough pose is taken to be."""


def next_click(
    points_model: np.ndarray, camera: PinholeCamera, modes: Sequence[PoseMode], click_sigma_px: float
) -> int:
    """Index of the point whose click gains most.

    With one mode: the one that lowers the mean variance of the points' projections most. With several: the one where
    the projections of the two most probable modes differ most, in standard deviations.

    Parameters
    ----------
    points_model
        ``(N, 3)`` points of the visible surface, mm, at least one.
    camera
        Intrinsics of the undistorted frame.
    modes
        The poses that the evidence allows, the most probable first.
    click_sigma_px
        Standard deviation of a click, in each image direction.
    """
    noise = click_sigma_px**2 * np.eye(2)
    if len(modes) > 1:
        seen = [camera.project(transform_points(mode.cam_from_model, points_model)) for mode in modes[:2]]
        spreads = [mode.uncertainty.pixel_covariances(points_model, camera, mode.cam_from_model) for mode in modes[:2]]
        apart = seen[0] - seen[1]
        squared = np.einsum(
            "ni,ni->n", apart, np.linalg.solve(spreads[0] + spreads[1] + noise, apart[..., None])[..., 0]
        )
        return int(np.nanargmax(squared))
    return int(np.argmax(gains_px2(points_model, camera, modes[0], click_sigma_px)))


def gains_px2(points_model: np.ndarray, camera: PinholeCamera, mode: PoseMode, click_sigma_px: float) -> np.ndarray:
    """``(N,)`` px^2: by how much a click at each of ``(N, 3)`` points lowers the mean variance of their projections."""
    covariance = mode.uncertainty.covariance
    jacobians = jacobian_at(points_model, camera, mode.cam_from_model, mode.uncertainty.pivot_model)
    surface = np.einsum("nki,nkj->ij", jacobians, jacobians) / len(points_model)
    across = covariance @ np.swapaxes(jacobians, -1, -2)
    spreads = jacobians @ across + click_sigma_px**2 * np.eye(2)
    lowered = np.swapaxes(across, -1, -2) @ surface @ across
    return np.trace(np.linalg.solve(spreads, lowered), axis1=1, axis2=2)


def rough_mode(
    cam_from_model: np.ndarray,
    landmarks: Sequence[Landmark],
    points_model: np.ndarray,
    camera: PinholeCamera,
    click_sigma_px: float,
) -> PoseMode:
    """What a rough pose ``(4, 4)`` and landmarks too few for a pose say together, for the next click.

    The rough pose counts as off by about :data:`ROUGH_DEG` and :data:`ROUGH_RELATIVE_DEPTH` of its distance.
    """
    pivot = points_model.mean(axis=0)
    radius = float(np.sqrt(((points_model - pivot) ** 2).sum(axis=1).mean()))
    pivot_cam = transform_points(cam_from_model, pivot)
    angle = np.radians(ROUGH_DEG)
    shift, depth = angle * radius, ROUGH_RELATIVE_DEPTH * float(np.linalg.norm(pivot_cam))
    precision = np.diag(np.array([shift, shift, depth, angle, angle, angle]) ** -2.0)
    points, _ = landmark_arrays(tuple(complete_landmarks(landmarks).values()))
    jacobian = jacobian_at(points, camera, cam_from_model, pivot).reshape(-1, 6)
    covariance = np.linalg.inv(precision + jacobian.T @ jacobian / click_sigma_px**2)
    uncertainty = PoseUncertainty(pivot, covariance, np.inf, click_sigma_px, radius, pivot_cam)
    return PoseMode(cam_from_model, uncertainty, 1.0, np.ones(len(points), bool))
