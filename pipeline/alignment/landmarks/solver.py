"""From landmark pairs to the pose of the camera: robust perspective-n-point. Needs ``cv2``."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...camera.pinhole import PinholeCamera
from ...errors import InputError
from ...files.numbers import format_two_digits
from ...transforms import rotation_angle_deg
from .covariance import PoseUncertainty, pose_uncertainty
from .degeneracy import (
    UndeterminedPose,
    ambiguity,
    check_correspondences,
    check_fit,
    check_uncertainty,
    repeated_correspondences,
)
from .hypotheses import Hypothesis, hypotheses
from .reprojection import Correspondences, Poses, residuals

__all__ = ["PoseEstimate", "UndeterminedPose", "solve_pose"]

FEW_PAIRS = 6
RIVAL_ODDS = 0.05
"""A second pose counts as possible if it is at least so probable, relative to the best one."""

RIVAL_APART_DEG, RIVAL_APART_SIGMAS = 3.0, 5.0
"""Two possible poses nearer than this, in angle and in the pixels of the pairs, are one for the user."""

CONTRADICTION_DEG = 10.0
"""If possible poses that differ on which pairs are wrong are no farther apart, the best is given and the doubt told."""

NEAR_DEG, MUCH_NEARER = 30.0, 3.0
"""Of possible poses the one near the start is taken: within this angle of it, all others so many times farther."""

DOUBTFUL = 2.5
"""Residuals of more than so many times the stated noise are told."""

VAGUE_TURN_DEG, VAGUE_DEPTH = 2.0, 0.03
"""Standard deviations of a rotation, and of the depth relative to itself, beyond which the user is told."""

MIRROR_ODDS = 1000.0
"""The mirror image must explain the pairs so many times better to be mentioned: mirrored meshes are rare."""


@dataclass(frozen=True)
class PoseEstimate:
    """The pose that explains the pairs best.

    Attributes
    ----------
    cam_from_model
        ``(4, 4)``, mm, OpenCV axes.
    residuals_px
        ``(N, 2)`` clicked minus predicted pixel of every pair; NaN for an outlier behind the camera.
    inliers
        ``(N,)`` bool: the pairs that it was fitted to.
    rms_px
        Root mean square length of the inliers' residuals.
    uncertainty
        Of this pose.
    told
        Warnings for the user, whole sentences.
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
    """The pose from pairs of a surface point and the pixel that shows it.

    Closed-form solutions of all pairs and of samples of three are refined (Levenberg-Marquardt); from 5 pairs on, wrong
    ones are left out; the most probable explanation wins. Deterministic; of the order of 10 ms for 20 pairs.

    Parameters
    ----------
    points_model
        ``(N, 3)`` mm.
    pixels
        ``(N, 2)`` in the undistorted frame.
    camera
        Intrinsics of the undistorted frame.
    click_sigma_px
        Standard deviation of a click, in each image direction.
    start
        The present cam_from_model, if there is one: decides between poses that fit equally well.
    names
        What messages call the pairs; their numbers from 1 if left out.

    Raises
    ------
    UndeterminedPose
        The pairs do not determine a pose: see :mod:`.degeneracy`.
    InputError
        Arrays of the wrong shape, numbers that are not finite, a click noise that is not positive.
    """
    points_model, pixels, names = _checked(points_model, pixels, names, click_sigma_px)
    check_correspondences(points_model, pixels, names)
    pairs = Correspondences.about(points_model, pixels, camera)
    found = hypotheses(pairs, _start(start, pairs), click_sigma_px)
    mirrored = _mirrored(pairs, found, click_sigma_px)
    check_fit(pairs, found, mirrored, click_sigma_px)
    chosen, messages = _chosen(pairs, found, start, click_sigma_px, names)
    cam_from_model = chosen.pose.matrix(0, pairs.pivot_model)
    fitted = Correspondences.about(points_model[chosen.inliers], pixels[chosen.inliers], camera)
    uncertainty = pose_uncertainty(fitted, cam_from_model, click_sigma_px)
    check_uncertainty(fitted, cam_from_model, uncertainty, click_sigma_px)
    apart = residuals(pairs, chosen.pose)[0][0]
    return PoseEstimate(
        cam_from_model=cam_from_model,
        residuals_px=apart,
        inliers=chosen.inliers,
        rms_px=float(np.sqrt(chosen.squared_px / chosen.inliers.sum())),
        uncertainty=uncertainty,
        messages=(
            *messages,
            *(
                f"{names[second]!r} repeats {names[first]!r}, which counts twice: delete one."
                for first, second in repeated_correspondences(points_model, pixels)
            ),
            *_warnings(chosen, apart, uncertainty, mirrored, click_sigma_px, names),
        ),
    )


def _checked(
    points_model: np.ndarray, pixels: np.ndarray, names: Sequence[str] | None, click_sigma_px: float
) -> tuple[np.ndarray, np.ndarray, list[str]]:
    points, clicks = np.asarray(points_model, np.float64), np.asarray(pixels, np.float64)
    if points.size == clicks.size == 0:  # an empty list has no columns
        points, clicks = np.zeros((0, 3)), np.zeros((0, 2))
    count = len(points)
    if points.shape != (count, 3) or clicks.shape != (count, 2):
        raise InputError(
            f"landmarks: expected N points (N, 3) and as many pixels (N, 2), found {points.shape} and {clicks.shape}"
        )
    labels = [str(number) for number in range(1, count + 1)] if names is None else [str(name) for name in names]
    if len(labels) != count:
        raise InputError(f"landmarks: expected a name for each of {count} pairs, found {len(labels)} names")
    unusable = ~(np.isfinite(points).all(axis=1) & np.isfinite(clicks).all(axis=1))
    if unusable.any():
        name = labels[int(np.argmax(unusable))]
        raise InputError(f"landmarks: expected finite coordinates, found NaN or infinity in {name!r}; pick it again")
    if not (np.isfinite(click_sigma_px) and click_sigma_px > 0):
        raise InputError(f"click noise: expected a positive number of pixels, found {click_sigma_px!r}")
    return points, clicks, labels


def _start(start: np.ndarray | None, pairs: Correspondences) -> Poses:
    matrices = np.zeros((0, 4, 4)) if start is None else np.asarray(start, np.float64)[None]
    return Poses.of(matrices, pairs.pivot_model)


def _mirrored(pairs: Correspondences, found: list[Hypothesis], click_sigma_px: float) -> Hypothesis | None:
    """What explains the mirror image of the points, if that fits them much better than the points do."""
    if found and found[0].inliers.all() and found[0].noise_px <= DOUBTFUL * click_sigma_px:
        return None
    image = Correspondences(-pairs.offsets, pairs.pixels, pairs.camera, pairs.pivot_model)
    mirrored = hypotheses(image, _start(None, pairs), click_sigma_px, doubting=False)
    if not mirrored or (found and mirrored[0].log_evidence - found[0].log_evidence < np.log(MIRROR_ODDS)):
        return None
    return mirrored[0]


def _chosen(
    pairs: Correspondences, found: list[Hypothesis], start: np.ndarray | None, click_sigma_px: float, names: list[str]
) -> tuple[Hypothesis, list[str]]:
    """The best hypothesis, or of several possible ones the one near the start, and what to tell of that."""
    rivals = [each for each in found[1:] if _rivals(pairs, found[0], each, click_sigma_px)]
    if not rivals:
        return found[0], []
    possible = [found[0], *rivals]
    turns = [_turn_deg(found[0].pose, each.pose) for each in rivals]
    if max(turns) <= CONTRADICTION_DEG and not any(_agree(found[0], each) for each in rivals):
        doubtful = " or ".join(repr(names[index]) for index in np.flatnonzero(found[0].inliers != rivals[0].inliers))
        return found[0], [
            f"The pairs fit another pose, {format_two_digits(turns[0])}° apart, nearly as well: check {doubtful}, "
            "and add pairs."
        ]
    if start is not None:
        present = _start(start, pairs)
        angles = np.array([_turn_deg(present, each.pose) for each in possible])
        nearest = int(np.argmin(angles))
        others = np.delete(angles, nearest)
        if angles[nearest] <= NEAR_DEG and others.min() >= MUCH_NEARER * angles[nearest]:
            return possible[nearest], [
                f"The pairs fit {len(possible)} poses nearly equally (up to {max(turns):.0f}° apart); the one nearest "
                "the present pose was taken: add a pair well above or below the others to be sure."
            ]
    raise ambiguity(pairs, possible, max(turns), names, click_sigma_px)


def _agree(one: Hypothesis, other: Hypothesis) -> bool:
    return np.array_equal(one.inliers, other.inliers)


def _rivals(pairs: Correspondences, best: Hypothesis, other: Hypothesis, click_sigma_px: float) -> bool:
    """Whether another hypothesis is nearly as probable as the best one, and another pose for the user."""
    if other.log_evidence - best.log_evidence < np.log(RIVAL_ODDS):
        return False
    predicted = residuals(pairs, best.pose)[0][0] - residuals(pairs, other.pose)[0][0]
    shift_px = float(np.nanmax(np.linalg.norm(predicted, axis=1)))
    turn_deg = _turn_deg(best.pose, other.pose)
    if turn_deg < RIVAL_APART_DEG and shift_px < RIVAL_APART_SIGMAS * click_sigma_px:
        return False
    # what lies inside the region that is shown anyway is no surprise
    fitted = Correspondences.about(
        pairs.offsets[best.inliers] + pairs.pivot_model, pairs.pixels[best.inliers], pairs.camera
    )
    estimate, rival = (each.pose.matrix(0, pairs.pivot_model) for each in (best, other))
    return not pose_uncertainty(fitted, estimate, click_sigma_px).contains(rival, estimate)


def _turn_deg(one: Poses, other: Poses) -> float:
    return rotation_angle_deg(one.rotations[0] @ other.rotations[0].T)


def _warnings(
    chosen: Hypothesis,
    apart: np.ndarray,
    uncertainty: PoseUncertainty,
    mirrored: Hypothesis | None,
    click_sigma_px: float,
    names: list[str],
) -> list[str]:
    messages = []
    for index in np.flatnonzero(~chosen.inliers):
        length = np.linalg.norm(apart[index])
        seen = f"is {length:.3g} px off where the others put it" if np.isfinite(length) else "lies behind the camera"
        messages.append(f"{names[index]!r} {seen} and was left out: check it, or disable it.")
    if mirrored is not None:
        messages.append(
            "The mirror image of the surface fits these pairs much better than the surface itself: check whether the "
            "mesh is mirrored."
        )
    if chosen.noise_px > DOUBTFUL * click_sigma_px:
        messages.append(
            f"The residuals are larger than clicks of {click_sigma_px:g} px explain (they look like "
            f"{format_two_digits(chosen.noise_px)} px): check the pairs, K and the mesh."
        )
    turn_deg, depth = uncertainty.largest_rotation_deg, uncertainty.relative_depth
    if turn_deg > VAGUE_TURN_DEG or depth > VAGUE_DEPTH:
        messages.append(f"The pairs leave the pose vague ({uncertainty.weakest}): spread them farther apart.")
    count = int(chosen.inliers.sum())
    if count < FEW_PAIRS:
        messages.append(
            f"The pose rests on {count} pairs, which hardly check each other: {FEW_PAIRS} or more are better."
        )
    return messages
