"""Localise a frame without any rough pose: by features shared with a bank of known views of the surface.

RootSIFT (Arandjelović & Zisserman 2012): SIFT finds features at any scale and roll, so the views differ in tilt only.
"""

from collections.abc import Sequence
from typing import NamedTuple

import cv2
import numpy as np

from ..alignment.levenberg_marquardt import Loss, fit_poses
from ..alignment.reprojection import Correspondences, Poses
from ..camera.pinhole import PinholeCamera
from ..poses.distributions import ReferencePose
from ..transforms import rigid, transform_points
from .known_views import KnownView, KnownViews

TILTS_DEG = ((0.0, 1), (25.0, 6), (50.0, 8))
"""Tilts of the views, and how many directions they go in."""

FEATURES, CONTRAST = 4000, 0.01
EDGE_PX = 4
"""Features nearer to the border of what a view shows are left out: the border is not in the frame."""

NEIGHBOURS, RATIO = 6, 0.85
"""Nearest features of the bank, and how much nearer the best one must be than the first at another place."""

SAME_PLACE = 0.02
"""Distance of features at one place, as a share of the surface's size in the aligned frame."""

INLIER_PX = 4.0
"""How far a feature may lie from its place at the pose: beside edges of the surface its depth is coarse."""

TRIALS, CONFIDENCE = 3000, 0.9999
LEAST_INLIERS = 10
LOSS_PX = 2.0


class ViewBank:
    """Features of the known views, with their places on the surface."""

    def __init__(self, views: Sequence[KnownView]) -> None:
        """Find the features of views; the first is the aligned frame's."""
        descriptors, points = zip(*(_lifted_features(view) for view in views), strict=True)
        self._points = np.concatenate(points)
        self._matcher = cv2.FlannBasedMatcher({"algorithm": 1, "trees": 4}, {"checks": 64})
        self._matcher.add([np.concatenate(descriptors)])
        # its trees are random: the same ones every time
        cv2.setRNGSeed(0)
        self._matcher.train()
        spread = np.ptp(points[0], axis=0) if len(points[0]) else np.zeros(3)
        self._same_mm = SAME_PLACE * float(np.linalg.norm(spread))

    def __len__(self) -> int:
        """The number of features."""
        return len(self._points)

    def matches(self, grey: np.ndarray, valid: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """What a frame shares with the bank: ``(N, 2)`` pixels, and ``(N, 3)`` points of the surface, mm.

        ``grey`` is ``(H, W)`` uint8, ``valid`` ``(H, W)`` bool.
        """
        keypoints, descriptors = _features(grey, valid)
        if len(keypoints) == 0 or len(self._points) < NEIGHBOURS:
            return np.empty((0, 2)), np.empty((0, 3))
        found = self._matcher.knnMatch(descriptors, k=NEIGHBOURS)
        index = np.array([[match.trainIdx for match in row] for row in found])
        distance = np.array([[match.distance for match in row] for row in found])
        apart = np.linalg.norm(self._points[index] - self._points[index[:, :1]], axis=2) > self._same_mm
        # where all neighbours lie at one place, the last one bounds the next place's distance from below
        other = np.where(apart.any(axis=1), np.argmax(apart, axis=1), NEIGHBOURS - 1)
        clear = distance[:, 0] < RATIO * distance[np.arange(len(distance)), other]
        return keypoints[clear], self._points[index[clear, 0]]


def bank_of(views: KnownViews, pivot_model: np.ndarray) -> ViewBank:
    """The bank of the views around an aligned frame; ``pivot_model`` ``(3,)`` mm is the middle of what it shows."""
    reference = ReferencePose(views.source.cam_from_model, pivot_model)
    poses = []
    for tilt_deg, count in TILTS_DEG:
        tilt = np.radians(tilt_deg)
        for angle in 2 * np.pi * np.arange(count) / count:
            poses.append(reference.orbit((tilt * np.cos(angle), tilt * np.sin(angle)), 0.0, reference.distance_mm))
    return ViewBank([views.at(pose) for pose in poses])


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


def _features(grey: np.ndarray, mask: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """``(N, 2)`` pixels and ``(N, 128)`` descriptors, compared by their Euclidean distance."""
    keypoints, descriptors = cv2.SIFT.create(FEATURES, contrastThreshold=CONTRAST).detectAndCompute(
        grey, mask.astype(np.uint8)
    )
    if descriptors is None:
        return np.empty((0, 2)), np.empty((0, 128), np.float32)
    root = np.sqrt(descriptors / np.maximum(descriptors.sum(axis=1, keepdims=True), 1e-6))
    return np.array([keypoint.pt for keypoint in keypoints]), root.astype(np.float32)


def _lifted_features(view: KnownView) -> tuple[np.ndarray, np.ndarray]:
    """Descriptors, and ``(N, 3)`` points of the surface."""
    inside = cv2.erode(view.shown.astype(np.uint8), np.ones((2 * EDGE_PX + 1,) * 2, np.uint8)) > 0
    pixels, descriptors = _features(view.grey, inside)
    return descriptors, view.lifted(pixels)
