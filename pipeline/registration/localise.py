"""Localise a frame: its pose from features shared with a bank of known views, without any rough pose."""

from typing import NamedTuple

import cv2
import numpy as np

from ..alignment.levenberg_marquardt import Loss, fit_poses
from ..alignment.reprojection import Correspondences, Poses
from ..camera.pinhole import PinholeCamera
from ..transforms import rigid, transform_points
from .view_bank import ViewBank

INLIER_PX = 4.0
"""How far a feature may lie from its place at the pose: beside edges of the surface its depth is coarse."""

TRIALS, CONFIDENCE = 3000, 0.9999
LEAST_INLIERS = 10
LOSS_PX = 2.0


class Localised(NamedTuple):
    """A ``(4, 4)`` pose, and how many features agree with it."""

    cam_from_model: np.ndarray
    inliers: int


def localised(bank: ViewBank, camera: PinholeCamera, grey: np.ndarray, valid: np.ndarray) -> Localised | None:
    """The pose that most features agree with (RANSAC by AP3P, then a robust fit); ``None`` without enough of them.

    ``grey`` is ``(H, W)`` uint8, ``valid`` ``(H, W)`` bool.
    """
    pixels, points = bank.matches(grey, valid)
    if len(pixels) < LEAST_INLIERS:
        return None
    found, rotation_vector, position, inliers = cv2.solvePnPRansac(
        points, pixels, camera.k, np.zeros(0),
        iterationsCount=TRIALS, reprojectionError=INLIER_PX, confidence=CONFIDENCE, flags=cv2.SOLVEPNP_AP3P,
    )  # fmt: skip
    if not found or inliers is None or len(inliers) < LEAST_INLIERS:
        return None
    start = rigid(cv2.Rodrigues(rotation_vector)[0], position.ravel())
    chosen = inliers.ravel()
    known = Correspondences.about(points[chosen], pixels[chosen], camera)
    fitted, _ = fit_poses(known, Poses.of(start[None], known.pivot_model), loss=Loss(LOSS_PX))
    pose = fitted.matrix(0, known.pivot_model)
    with np.errstate(invalid="ignore"):
        residuals_px = np.linalg.norm(camera.project(transform_points(pose, points)) - pixels, axis=1)
        return Localised(pose, int(np.count_nonzero(residuals_px < INLIER_PX)))
