"""Where on the surface the next landmark gains most."""

from collections.abc import Sequence

import numpy as np

from ...camera.pinhole import PinholeCamera
from ...transforms import transform_points
from ..pose_uncertainty import PoseMode
from ..reprojection import jacobian_at


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
