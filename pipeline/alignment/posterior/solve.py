"""The pose from landmarks and image, in one solve. Needs ``cv2``.

Where the landmarks alone allow several poses, each is weighed with what the image says. That may be wrong altogether,
as a search may have ended at another place: then the pose of the landmarks alone is the more probable one, and the
image is left out, like an outlier among the landmarks.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ...camera.pinhole import PinholeCamera
from ...case.landmarks import Landmark
from ...files.numbers import format_two_digits
from ...transforms import transform_points
from ..confidence_region import f_survival
from ..landmarks.align_landmarks import LANDMARKS, Alignment, align_landmarks, complete_landmarks, landmark_arrays
from ..landmarks.covariance import REGION_PRIOR_DOF, SELECTION_PRIOR_DOF, NoiseEstimate
from ..landmarks.degeneracy import UndeterminedPose
from ..landmarks.hypotheses import NOISE_PRIOR_DOF
from ..landmarks.outliers import FALSE_ALARM_PROBABILITY
from ..landmarks.solver import RIVAL_ODDS, PoseEstimate, outlier_messages
from ..levenberg_marquardt import PosePrior, fit_poses
from ..pose_uncertainty import PoseEvidence, PoseMode, PoseUncertainty
from ..reprojection import Correspondences, Poses, jacobian_at, twist_between

IMAGE = "image"
"""The kind of evidence besides landmarks."""

WRONG_PROBABILITY, WRONG_DEG, WRONG_RELATIVE_DEPTH = 0.05, 5.0, 0.03
"""Probability that the image's pose is wrong, and how much farther off it is then: standard deviations of rotations,
of shifts across the view by as much of the surface's radius, and of the distance. Of 19 refinements accepted on LM-O,
two were wrong."""

NOISE_ROUNDS = 4
"""Rounds of estimating the click noise and the pose in turn."""


@dataclass(frozen=True)
class _Weighed:
    """A mode, the logarithm of its weight, and whether it leaves the image out."""

    mode: PoseMode
    log_weight: float
    is_alone: bool


def pose_posterior(
    landmarks: Sequence[Landmark],
    camera: PinholeCamera,
    image: PoseEvidence | None = None,
    *,
    click_sigma_px: float,
    start: np.ndarray | None = None,
) -> Alignment:
    """The pose from landmarks and image.

    Parameters
    ----------
    landmarks
        Any number, in one frame of the surface; those that are disabled or incomplete take no part.
    camera
        Intrinsics of the undistorted frame.
    image
        What the image says of the pose, which it determines; without, the pose is that of :func:`.align_landmarks`.
    click_sigma_px
        Standard deviation of a click, in each image direction.
    start
        ``(4, 4)`` the present pose, which decides between poses that fit equally well, if nothing else does.

    Raises
    ------
    UndeterminedPose
        The evidence allows several poses, or none, see :mod:`..landmarks.degeneracy`.
    InputError
        Numbers that are not finite, a click noise that is not positive.
    """
    if image is None:
        return align_landmarks(landmarks, camera, click_sigma_px=click_sigma_px, start=start)
    used = complete_landmarks(landmarks)
    names = [landmark.name for landmark in used.values()]
    pairs = Correspondences.about(*landmark_arrays(tuple(used.values())), camera, image.uncertainty.pivot_model)
    modes, messages = _landmark_modes(landmarks, camera, click_sigma_px)
    if modes:
        possible = _weighed(modes, pairs, image, click_sigma_px)
    else:
        joint = _joined(pairs, image, image.cam_from_model, _explained(pairs, image, click_sigma_px), click_sigma_px)
        possible = [_Weighed(joint, 0.0, is_alone=False)]
    if len(possible) > 1:
        weights = np.exp([each.log_weight - possible[0].log_weight for each in possible])
        shares = (weights / weights.sum()).tolist()
        found = [replace(each.mode, probability=share) for each, share in zip(possible, shares, strict=True)]
        raise UndeterminedPose(
            "ambiguous",
            f"landmarks and image: {len(found)} poses fit nearly equally well; add a pair where they lie farthest "
            "apart, or switch off what is wrong",
            [mode.cam_from_model for mode in found],
            found,
        )
    mode, is_alone = possible[0].mode, possible[0].is_alone
    kinds = tuple(kind for kind, counts in ((LANDMARKS, mode.inliers.any()), (IMAGE, not is_alone)) if counts)
    residuals_px = _residuals_px(pairs, mode.cam_from_model)
    if is_alone:
        shown = transform_points(image.cam_from_model, pairs.offsets + pairs.pivot_model)
        apart_px = np.linalg.norm(pairs.pixels - residuals_px - camera.project(shown), axis=1)
        left_out = (
            f"The image is left out: its pose lies {format_two_digits(float(np.median(apart_px)))} px from that of "
            "the landmarks, more than the errors of both allow. Check the landmarks, or refine again from their pose."
        )
        messages = left_out, *messages
    else:
        messages = tuple(outlier_messages(residuals_px, mode.inliers, names))
    squared_px = (residuals_px[mode.inliers] ** 2).sum(axis=1)
    rms_px = float(np.sqrt(squared_px.mean())) if len(squared_px) else 0.0
    estimate = PoseEstimate(mode.cam_from_model, residuals_px, mode.inliers, rms_px, mode.uncertainty, messages)
    return Alignment(tuple(used.values()), tuple(used), camera, estimate, click_sigma_px, kinds)


def _residuals_px(pairs: Correspondences, cam_from_model: np.ndarray) -> np.ndarray:
    return pairs.pixels - pairs.camera.project(transform_points(cam_from_model, pairs.offsets + pairs.pivot_model))


def _landmark_modes(
    landmarks: Sequence[Landmark], camera: PinholeCamera, click_sigma_px: float
) -> tuple[Sequence[PoseMode], tuple[str, ...]]:
    """The poses that the landmarks alone allow, possibly undetermined in some direction, and what is said of them."""
    try:
        found = align_landmarks(landmarks, camera, click_sigma_px=click_sigma_px).estimate
    except UndeterminedPose as refusal:
        return refusal.modes, (str(refusal),)
    return [PoseMode(found.cam_from_model, found.uncertainty, 1.0, found.inliers)], found.messages


def _weighed(
    modes: Sequence[PoseMode], pairs: Correspondences, image: PoseEvidence, click_sigma_px: float
) -> list[_Weighed]:
    """The poses that landmarks and image allow, the most probable first, and none twice."""
    trials = []
    for mode in modes:
        pivot = image.uncertainty.pivot_model
        spread = mode.uncertainty.about(pivot, mode.cam_from_model)
        apart = twist_between(image.cam_from_model, mode.cam_from_model, pivot)
        right = spread.covariance + image.uncertainty.covariance
        wrong = right + np.diag(_wrong_deviations(image.uncertainty) ** 2)
        shares = np.linalg.eigvals(np.linalg.solve(right, spread.covariance)).real
        dof = joint_dof(np.stack([shares, 1 - shares]), [spread.dof, image.uncertainty.dof])
        log_right = _log_density(apart, right, dof)
        log_wrong = _log_density(apart, wrong, np.inf)
        joint = _joined(pairs, image, mode.cam_from_model, mode.inliers, click_sigma_px)
        log_share = math.log(max(mode.probability, 1e-300))
        trials += [
            _Weighed(joint, log_share + math.log(1 - WRONG_PROBABILITY) + log_right, is_alone=False),
            _Weighed(mode, log_share + math.log(WRONG_PROBABILITY) + log_wrong, is_alone=True),
        ]
    trials.sort(key=lambda each: -each.log_weight)
    kept: list[_Weighed] = []
    for each in trials:
        likely = each.log_weight - trials[0].log_weight >= math.log(RIVAL_ODDS)
        pose = each.mode.cam_from_model
        if likely and not any(known.mode.uncertainty.contains(pose, known.mode.cam_from_model) for known in kept):
            kept.append(each)
    return kept


def _wrong_deviations(uncertainty: PoseUncertainty) -> np.ndarray:
    """``(6,)`` standard deviations of an image's pose that is wrong."""
    angle = math.radians(WRONG_DEG)
    across, depth = angle * uncertainty.radius_mm, WRONG_RELATIVE_DEPTH * float(np.linalg.norm(uncertainty.pivot_cam))
    return np.array([across, across, depth, angle, angle, angle])


def _log_density(apart: np.ndarray, covariance: np.ndarray, dof: float) -> float:
    """Logarithm of the density of a twist ``(6,)``: normal, or Student's with some degrees of freedom."""
    scale = np.sqrt(np.diag(covariance))
    whitened = np.linalg.solve(np.linalg.cholesky(covariance / np.outer(scale, scale)), apart / scale)
    squared = float(whitened @ whitened)
    half_log_det = 0.5 * float(np.linalg.slogdet(covariance / np.outer(scale, scale))[1]) + float(np.log(scale).sum())
    if math.isinf(dof):
        return -3 * math.log(2 * math.pi) - half_log_det - squared / 2
    half = dof / 2
    constant = math.lgamma(half + 3) - math.lgamma(half) - 3 * math.log(dof * math.pi)
    return constant - half_log_det - (half + 3) * math.log1p(squared / dof)


def _explained(pairs: Correspondences, image: PoseEvidence, click_sigma_px: float) -> np.ndarray:
    """``(N,)`` bool: which of some correspondences the image does not contradict."""
    points = pairs.offsets + pairs.pivot_model
    spreads = image.uncertainty.pixel_covariances(points, pairs.camera, image.cam_from_model)
    apart = np.nan_to_num(_residuals_px(pairs, image.cam_from_model), nan=np.inf)
    spreads = spreads + click_sigma_px**2 * np.eye(2)
    squared = np.einsum("ni,ni->n", apart, np.linalg.solve(spreads, apart[..., None])[..., 0])
    least = FALSE_ALARM_PROBABILITY / max(len(pairs), 1)
    return np.array([f_survival(value / 2, 2, NOISE_PRIOR_DOF) >= least for value in squared], bool)


def _joined(
    pairs: Correspondences, image: PoseEvidence, start: np.ndarray, inliers: np.ndarray, click_sigma_px: float
) -> PoseMode:
    """The pose from some of the correspondences and the image, from a start ``(4, 4)``.

    The noise of both is estimated from how far they lie from the joint pose, together with what is stated of it. Of the
    six degrees of freedom of the pose, each has determined its share, and keeps the rest for its noise.
    """
    if not inliers.any():
        return PoseMode(image.cam_from_model, image.uncertainty, 1.0, inliers)
    chosen, pivot, stated = pairs[inliers], pairs.pivot_model, image.uncertainty
    points, precision = chosen.offsets + pivot, np.linalg.inv(stated.covariance)
    root, mean, pose = np.linalg.cholesky(precision).T, Poses.of(image.cam_from_model[None], pivot), start
    noise, scale = NoiseEstimate(click_sigma_px**2, 0, SELECTION_PRIOR_DOF), 1.0
    for _ in range(NOISE_ROUNDS):
        prior = PosePrior(mean, noise.sigma_px / math.sqrt(scale) * root)
        fitted, _ = fit_poses(chosen, Poses.of(pose[None], pivot), prior=prior)
        pose = fitted.matrix(0, pivot)
        jacobian = jacobian_at(points, pairs.camera, pose, pivot).reshape(-1, 6)
        normal = jacobian.T @ jacobian
        covariance = np.linalg.inv(normal / noise.variance + precision / scale)
        share = float(np.trace(covariance @ normal)) / noise.variance / 6
        squared_px = float((_residuals_px(chosen, pose) ** 2).sum())
        noise = NoiseEstimate.of(squared_px, 2 * len(chosen) - 6 * share, click_sigma_px, SELECTION_PRIOR_DOF)
        if math.isfinite(stated.dof):
            apart = twist_between(image.cam_from_model, pose, pivot)
            scale = (stated.dof + float(apart @ precision @ apart)) / (stated.dof + 6 * share)
    # the region allows for a stated noise that is wrong
    noise = NoiseEstimate.of(squared_px, 2 * len(chosen) - 6 * share, click_sigma_px, REGION_PRIOR_DOF)
    covariance = np.linalg.inv(normal / noise.variance + precision / scale)
    shares = np.linalg.eigvals(covariance @ normal).real / noise.variance
    # where the image decides alone, nothing was learned of its noise
    dof = joint_dof(np.stack([shares, 1 - shares]), [noise.region_dof, stated.dof])
    pivot_cam = transform_points(pose, pivot)
    uncertainty = replace(stated, covariance=covariance, dof=dof, sigma_px=noise.sigma_px, pivot_cam=pivot_cam)
    return PoseMode(pose, uncertainty, 1.0, inliers)


def joint_dof(shares: np.ndarray, dofs: Sequence[float]) -> float:
    """Degrees of freedom of a sum of covariances, each estimated with its own: Welch and Satterthwaite's.

    Parameters
    ----------
    shares
        ``(K, D)`` fractions of the sum, 0..1, in each of D directions; the inverses of theirs are averaged.
    dofs
        ``(K,)`` of each.
    """
    total = float((shares**2 / np.array(dofs)[:, None]).sum(axis=0).mean())
    return 1 / total if total > 0 else np.inf


def pulls_px(found: Alignment, image: PoseEvidence | None, points_model: np.ndarray) -> dict[str, float | None]:
    """Kind of evidence -> median shift of surface points in the image when this kind is left out.

    ``None`` where the rest determines no pose.

    ``found`` is the pose from all evidence, ``points_model`` ``(N, 3)`` points of the visible surface, mm.
    """
    shown = found.camera.project(transform_points(found.estimate.cam_from_model, points_model))
    pulls: dict[str, float | None] = {}
    for kind, landmarks, rest in ((LANDMARKS, (), image), (IMAGE, found.landmarks, None)):
        if not (found.landmarks if kind == LANDMARKS else image):
            continue
        try:
            pose = pose_posterior(landmarks, found.camera, rest, click_sigma_px=found.click_sigma_px)
        except UndeterminedPose:
            pulls[kind] = None
            continue
        moved = found.camera.project(transform_points(pose.estimate.cam_from_model, points_model)) - shown
        pulls[kind] = float(np.nanmedian(np.linalg.norm(moved, axis=1)))
    return pulls
