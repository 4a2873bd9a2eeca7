"""The pose from 2D-3D correspondences: robust perspective-n-point. Needs ``cv2``."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...camera.pinhole import PinholeCamera
from ...errors import InputError
from ...files.numbers import format_two_digits
from ...transforms import rotation_angle_deg
from ..pose_uncertainty import PoseMode, PoseUncertainty
from ..reprojection import Correspondences, Poses, residuals
from .covariance import pose_uncertainty
from .degeneracy import (
    UndeterminedPose,
    ambiguous_pose,
    check_correspondences,
    check_fit,
    check_uncertainty,
    repeated_correspondences,
)
from .hypotheses import Hypothesis, hypotheses

__all__ = ["PoseEstimate", "UndeterminedPose", "solve_pose"]

FEW_CORRESPONDENCES = 6
"""Fewer inliers than this give a warning."""

RIVAL_ODDS = 0.01
"""A second hypothesis is a rival if its probability relative to the best one is at least this. Careless clicks on a
flat rim can make the wrong tilt 20 times as probable as the right one."""

RIVAL_MIN_DEG, RIVAL_MIN_SIGMAS = 3.0, 5.0
"""Poses that differ by less than both, in angle and in projected points over click noise, count as the same."""

CONTRADICTION_MAX_DEG = 10.0
"""Rivals with other inliers that differ by at most this from the best pose give a warning, not a refusal."""

NEAR_START_DEG, NEARER_START_RATIO = 30.0, 3.0
"""The initial pose decides between rivals if one is within this angle, and all others are this many times as far."""

LARGE_NOISE_RATIO = 2.5
"""Ratio of estimated to stated click noise beyond which a warning is given."""

UNCERTAIN_ROTATION_DEG, UNCERTAIN_RELATIVE_DEPTH = 2.0, 0.03
"""Standard deviations of a rotation, and of the depth relative to the depth, beyond which a warning is given."""

MIRROR_ODDS = 1000.0
"""A warning suggests a mirrored mesh if the mirror image is more probable by this factor: mirrored meshes are rare."""


@dataclass(frozen=True)
class PoseEstimate:
    """The most probable pose.

    Attributes
    ----------
    cam_from_model
        ``(4, 4)``, mm, OpenCV axes.
    residuals_px
        ``(N, 2)`` clicked minus projected pixel; NaN for an outlier behind the camera.
    inliers
        ``(N,)`` bool: the correspondences that the pose was fitted to.
    rms_px
        Root mean square length of the inliers' residuals.
    uncertainty
        That of this pose.
    messages
        Warnings for the user, full sentences.
    """

    cam_from_model: np.ndarray
    residuals_px: np.ndarray
    inliers: np.ndarray
    rms_px: float
    uncertainty: PoseUncertainty
    messages: tuple[str, ...]


def solve_pose(
    points_model: np.ndarray,
    pixels: np.ndarray,
    camera: PinholeCamera,
    *,
    click_sigma_px: float = 2.0,
    start: np.ndarray | None = None,
    names: Sequence[str] | None = None,
) -> PoseEstimate:
    """Estimate the pose from surface points and the pixels that show them.

    Closed-form solutions from all correspondences and from samples of three are refined (Levenberg-Marquardt). From 5
    correspondences on, outliers are excluded. The most probable hypothesis wins. Deterministic; takes about 10 ms for
    20 correspondences.

    Parameters
    ----------
    points_model
        ``(N, 3)`` mm.
    pixels
        ``(N, 2)`` clicked pixels of the undistorted frame.
    camera
        Intrinsics of the undistorted frame.
    click_sigma_px
        Click noise: standard deviation in each image direction.
    start
        ``(4, 4)`` initial cam_from_model, if there is one: decides between poses that fit equally well.
    names
        Names of the correspondences in messages; by default their numbers from 1.

    Raises
    ------
    UndeterminedPose
        The correspondences do not determine a pose: see :mod:`.degeneracy`.
    InputError
        The click noise is not positive.
    """
    if not (np.isfinite(click_sigma_px) and click_sigma_px > 0):
        raise InputError(f"click noise: expected a positive number of pixels, found {click_sigma_px!r}")
    labels = list(names or map(str, range(1, len(points_model) + 1)))
    check_correspondences(points_model, pixels, labels)
    correspondences = Correspondences.about(points_model, pixels, camera)
    found = hypotheses(correspondences, _start_poses(start, correspondences), click_sigma_px)
    mirrored = _mirror_hypothesis(correspondences, found, click_sigma_px)
    check_fit(correspondences, found, mirrored, click_sigma_px)
    chosen, messages = _choose(correspondences, found, start, click_sigma_px, labels)
    mode = _mode(correspondences, chosen, 1.0, click_sigma_px)
    check_uncertainty(correspondences[chosen.inliers], mode, click_sigma_px)
    residuals_px, uncertainty = residuals(correspondences, chosen.pose)[0][0], mode.uncertainty
    return PoseEstimate(
        cam_from_model=mode.cam_from_model,
        residuals_px=residuals_px,
        inliers=chosen.inliers,
        rms_px=float(np.sqrt(chosen.squared_px / chosen.inliers.sum())),
        uncertainty=uncertainty,
        messages=(
            *messages,
            *(
                f"{labels[second]!r} repeats {labels[first]!r}, which then counts twice: delete one."
                for first, second in repeated_correspondences(points_model, pixels)
            ),
            *_warnings(chosen, residuals_px, uncertainty, mirrored, click_sigma_px, labels),
        ),
    )


def _mode(
    correspondences: Correspondences, hypothesis: Hypothesis, probability: float, click_sigma_px: float
) -> PoseMode:
    inliers, pivot = hypothesis.inliers, correspondences.pivot_model
    pose = hypothesis.pose.matrix(0, pivot)
    fitted = Correspondences.about(
        correspondences.offsets[inliers] + pivot, correspondences.pixels[inliers], correspondences.camera
    )
    return PoseMode(pose, pose_uncertainty(fitted, pose, click_sigma_px), probability, inliers)


def _start_poses(start: np.ndarray | None, correspondences: Correspondences) -> Poses:
    matrices = np.zeros((0, 4, 4)) if start is None else np.asarray(start, np.float64)[None]
    return Poses.of(matrices, correspondences.pivot_model)


def _mirror_hypothesis(
    correspondences: Correspondences, found: list[Hypothesis], click_sigma_px: float
) -> Hypothesis | None:
    """The best hypothesis for the mirror image of the points, if it is much more probable than the points' own."""
    if found and found[0].inliers.all() and found[0].noise_px <= LARGE_NOISE_RATIO * click_sigma_px:
        return None
    image = Correspondences(
        -correspondences.offsets, correspondences.pixels, correspondences.camera, correspondences.pivot_model
    )
    mirrored = hypotheses(image, _start_poses(None, correspondences), click_sigma_px, allow_outliers=False)
    if not mirrored or (found and mirrored[0].log_evidence - found[0].log_evidence < np.log(MIRROR_ODDS)):
        return None
    return mirrored[0]


def _choose(
    correspondences: Correspondences,
    found: list[Hypothesis],
    start: np.ndarray | None,
    click_sigma_px: float,
    names: list[str],
) -> tuple[Hypothesis, list[str]]:
    """Choose the best hypothesis, or among rivals the one near the initial pose; returns it with warnings.

    Raises
    ------
    UndeterminedPose
        There are rivals, and the initial pose does not decide between them.
    """
    rivals = [each for each in found[1:] if _is_rival(correspondences, found[0], each, click_sigma_px)]
    if not rivals:
        return found[0], []
    possible = [found[0], *rivals]
    rotations_deg = [_rotation_between_deg(found[0].pose, each.pose) for each in rivals]
    if max(rotations_deg) <= CONTRADICTION_MAX_DEG and not any(_same_inliers(found[0], each) for each in rivals):
        doubtful = " or ".join(repr(names[index]) for index in np.flatnonzero(found[0].inliers != rivals[0].inliers))
        return found[0], [
            "The correspondences fit another pose nearly as well, which differs by "
            f"{format_two_digits(rotations_deg[0])}°: check {doubtful}, and add pairs."
        ]
    if start is not None:
        current = _start_poses(start, correspondences)
        angles = np.array([_rotation_between_deg(current, each.pose) for each in possible])
        nearest = int(np.argmin(angles))
        others = np.delete(angles, nearest)
        if angles[nearest] <= NEAR_START_DEG and others.min() >= NEARER_START_RATIO * angles[nearest]:
            return possible[nearest], [
                f"The correspondences fit {len(possible)} poses nearly equally well, which differ by up to "
                f"{max(rotations_deg):.0f}°. The one nearest the current pose was taken: add a pair well above or "
                "below the others to be sure."
            ]
    odds = np.exp([each.log_evidence - possible[0].log_evidence for each in possible])
    modes = [
        _mode(correspondences, each, float(share), click_sigma_px)
        for each, share in zip(possible, odds / odds.sum(), strict=True)
    ]
    raise ambiguous_pose(correspondences, possible, modes, names, click_sigma_px)


def _same_inliers(one: Hypothesis, other: Hypothesis) -> bool:
    return np.array_equal(one.inliers, other.inliers)


def _is_rival(correspondences: Correspondences, best: Hypothesis, other: Hypothesis, click_sigma_px: float) -> bool:
    """Whether another hypothesis is nearly as probable as the best one, and a noticeably different pose."""
    if other.log_evidence - best.log_evidence < np.log(RIVAL_ODDS):
        return False
    predicted = residuals(correspondences, best.pose)[0][0] - residuals(correspondences, other.pose)[0][0]
    shift_px = float(np.nanmax(np.linalg.norm(predicted, axis=1)))
    rotation_deg = _rotation_between_deg(best.pose, other.pose)
    if rotation_deg < RIVAL_MIN_DEG and shift_px < RIVAL_MIN_SIGMAS * click_sigma_px:
        return False
    # a pose inside the displayed confidence region is not a rival
    mode = _mode(correspondences, best, 1.0, click_sigma_px)
    return not mode.uncertainty.contains(other.pose.matrix(0, correspondences.pivot_model), mode.cam_from_model)


def _rotation_between_deg(one: Poses, other: Poses) -> float:
    return rotation_angle_deg(one.rotations[0] @ other.rotations[0].T)


def outlier_messages(residuals_px: np.ndarray, inliers: np.ndarray, names: Sequence[str]) -> list[str]:
    """A sentence for each of the correspondences that are not inliers; arguments as in :class:`PoseEstimate`."""
    messages = []
    for index in np.flatnonzero(~inliers).tolist():
        error_px = np.linalg.norm(residuals_px[index])
        reason = f"has a reprojection error of {error_px:.3g} px" if np.isfinite(error_px) else "lies behind the camera"
        messages.append(f"Outlier: {names[index]!r} {reason} and was excluded. Check or disable it.")
    return messages


def _warnings(
    chosen: Hypothesis,
    residuals_px: np.ndarray,
    uncertainty: PoseUncertainty,
    mirrored: Hypothesis | None,
    click_sigma_px: float,
    names: list[str],
) -> list[str]:
    messages = outlier_messages(residuals_px, chosen.inliers, names)
    if mirrored is not None:
        messages.append(
            "The mirror image of the surface fits much better than the surface: check whether the mesh is mirrored."
        )
    if chosen.noise_px > LARGE_NOISE_RATIO * click_sigma_px:
        messages.append(
            f"The residuals are larger than a click noise of {click_sigma_px:g} px explains; they suggest "
            f"{format_two_digits(chosen.noise_px)} px. Check the correspondences, K and the mesh."
        )
    rotation_deg, depth = uncertainty.largest_rotation_deg, uncertainty.relative_depth
    if rotation_deg > UNCERTAIN_ROTATION_DEG or depth > UNCERTAIN_RELATIVE_DEPTH:
        messages.append(f"The pose is uncertain ({uncertainty.weakest}): spread the correspondences more widely.")
    count = int(chosen.inliers.sum())
    if count < FEW_CORRESPONDENCES:
        messages.append(
            f"The pose rests on {count} correspondences, with little redundancy to reveal errors: "
            f"use {FEW_CORRESPONDENCES} or more."
        )
    return messages
