"""Hypotheses: poses, each with its inliers and its probability given the correspondences.

Needs ``cv2``, through :mod:`.candidates`.
"""

import math
from dataclasses import dataclass

import numpy as np

from ..levenberg_marquardt import Loss, fit_poses
from ..reprojection import Correspondences, Poses, residuals
from .candidates import candidate_poses
from .outliers import select_inliers

OUTLIER_PROBABILITY, OUTLIER_RANGE_SIGMAS = 0.05, 50.0
"""Prior probability of an outlier, and the side of the square it is uniform in, in units of the click noise."""

SUSPICIOUS_NOISE_RATIO = 2.0
"""Noise estimate over stated noise beyond which the search for outliers starts."""

NOISE_PRIOR_DOF = 4.0
"""Degrees of freedom of the prior on the click noise when outliers are weighed against large noise."""

TRIPLES = 50
"""Samples of three correspondences: with 40 % outliers, all of them contain one with probability 5e-6."""

MAX_STARTS, MAX_CONSENSUS_TRIALS = 8, 4
"""Most candidates that are refined, and most poses that select their inliers."""

DISTINCT_START_DEG, DISTINCT_POSE_DEG = 2.0, 0.1
"""Candidates closer than the first lead to the same minimum; minima closer than the second are the same."""


@dataclass(frozen=True)
class Hypothesis:
    """A pose and its inliers.

    Attributes
    ----------
    pose
        One pose, fitted to the inliers by least squares.
    inliers
        ``(N,)`` bool.
    squared_px
        Sum of the squared residuals of the inliers, px^2.
    log_evidence
        Logarithm of the probability of the correspondences under the hypothesis, up to a constant common to all.
    """

    pose: Poses
    inliers: np.ndarray
    squared_px: float
    log_evidence: float

    @property
    def dof(self) -> int:
        """Degrees of freedom of the inliers' residuals."""
        return 2 * int(self.inliers.sum()) - 6

    @property
    def noise_px(self) -> float:
        """Noise estimate from the residuals alone: standard deviation in each image direction."""
        return math.sqrt(self.squared_px / self.dof)


def hypotheses(
    correspondences: Correspondences, start: Poses, click_sigma_px: float, *, allow_outliers: bool = True
) -> list[Hypothesis]:
    """Hypotheses, the most probable first; empty if no candidate has the points in front of the camera.

    The best candidates are refined by least squares. If that leaves large residuals and there are 5 correspondences or
    more, candidates are also refined with a bounded loss of decreasing scale, and the best of these select their
    inliers (:mod:`.outliers`).

    Of at least 4 correspondences; ``start`` are further initial poses, possibly none.
    """
    found = candidate_poses(correspondences, samples=TRIPLES if allow_outliers else 0)
    starts = Poses(
        np.concatenate([found.rotations, start.rotations]), np.concatenate([found.positions, start.positions])
    )
    if not len(starts):
        return []
    all_inliers = np.ones(len(correspondences), bool)
    fitted, cost = fit_poses(correspondences, _best_starts(correspondences, starts, 64 * click_sigma_px))
    trials = [(fitted[[number]], all_inliers) for number in np.argsort(cost) if np.isfinite(cost[number])]
    # residuals within the click noise leave no reason to look for outliers
    consistent = (
        cost.min(initial=np.inf) <= (2 * len(correspondences) - 6) * (SUSPICIOUS_NOISE_RATIO * click_sigma_px) ** 2
    )
    if allow_outliers and len(correspondences) > 4 and not consistent:
        trials += _consensus(correspondences, starts, click_sigma_px)
        inliers, pose = select_inliers(correspondences, fitted[[int(np.argmin(cost))]], all_inliers, click_sigma_px)
        trials = [(pose, inliers), *trials[1:]]
    explained: list[Hypothesis] = []
    for pose, inliers in _distinct(trials):
        squared_px = float((residuals(correspondences[inliers], pose)[0] ** 2).sum())
        if np.isfinite(squared_px):
            evidence = _log_evidence(correspondences, inliers, squared_px, click_sigma_px)
            explained.append(Hypothesis(pose, inliers, squared_px, evidence))
    return sorted(explained, key=lambda each: -each.log_evidence)


def _consensus(
    correspondences: Correspondences, starts: Poses, click_sigma_px: float
) -> list[tuple[Poses, np.ndarray]]:
    """Poses found with a bounded loss, each with its ``(N,)`` inliers."""
    robust = _best_starts(correspondences, starts, 16 * click_sigma_px)
    for scale in (16, 4):
        robust, cost = fit_poses(correspondences, robust, loss=Loss(scale * click_sigma_px), iterations=15)
    poses = [robust[[number]] for number in np.argsort(cost, kind="stable")]
    trials = _distinct([(pose, _small_residuals(correspondences, pose, 4 * click_sigma_px)) for pose in poses])
    selected = [
        select_inliers(correspondences, pose, inliers, click_sigma_px)
        for pose, inliers in trials[:MAX_CONSENSUS_TRIALS]
    ]
    return [(pose, inliers) for inliers, pose in selected]


def _best_starts(correspondences: Correspondences, poses: Poses, scale_px: float) -> Poses:
    """The poses of lowest bounded cost, distinct by :data:`DISTINCT_START_DEG`, at most :data:`MAX_STARTS`."""
    squared_px = (residuals(correspondences, poses)[0] ** 2).sum(axis=-1)
    order = np.argsort(Loss(scale_px)(squared_px)[0].sum(axis=1), kind="stable")
    kept: list[int] = []
    for number in order:
        close = _within_angle(poses.rotations[number], poses.rotations[kept], DISTINCT_START_DEG)
        if len(kept) < MAX_STARTS and not close.any():
            kept.append(int(number))
    return poses[kept]


def _distinct(trials: list[tuple[Poses, np.ndarray]]) -> list[tuple[Poses, np.ndarray]]:
    """Drop trials that have the same inliers and nearly the same rotation as an earlier one."""
    kept: list[tuple[Poses, np.ndarray]] = []
    for pose, inliers in trials:
        if not any(
            np.array_equal(inliers, others)
            and _within_angle(pose.rotations[0], other.rotations, DISTINCT_POSE_DEG).all()
            for other, others in kept
        ):
            kept.append((pose, inliers))
    return kept


def _within_angle(rotation: np.ndarray, rotations: np.ndarray, within_deg: float) -> np.ndarray:
    """``(K,)`` bool: which of ``(K, 3, 3)`` rotations differ from a ``(3, 3)`` one by at most an angle."""
    # |R - S|^2 = 8 sin^2(angle / 2); unlike the trace it is accurate for small angles
    return ((rotations - rotation) ** 2).sum(axis=(1, 2)) <= 8 * np.sin(np.radians(within_deg) / 2) ** 2


def _small_residuals(correspondences: Correspondences, pose: Poses, within_px: float) -> np.ndarray:
    """``(N,)`` bool: the residuals up to a bound, at least the 4 smallest."""
    length = np.nan_to_num(np.linalg.norm(residuals(correspondences, pose)[0][0], axis=-1), nan=np.inf)
    return length <= max(within_px, float(np.sort(length)[3]))


def _log_evidence(
    correspondences: Correspondences, inliers: np.ndarray, squared_px: float, click_sigma_px: float
) -> float:
    """Logarithm of the marginal likelihood: pose and noise are integrated out.

    Inliers are normal with unknown variance, whose prior is scaled inverse chi^2. With n inliers, nu prior degrees of
    freedom, sigma the stated noise and half = nu / 2 + n - 3 the result is
    pi^-(n - 3) Gamma(half) (nu sigma^2)^(nu/2) (nu sigma^2 + squared_px)^-half, times the probability of the outliers.
    The volume of the pose's posterior is taken as equal for all hypotheses.
    """
    count = int(inliers.sum())
    prior, half = NOISE_PRIOR_DOF * click_sigma_px**2, NOISE_PRIOR_DOF / 2 + count - 3
    log_inliers = -(count - 3) * math.log(math.pi) + math.lgamma(half) + NOISE_PRIOR_DOF / 2 * math.log(prior)
    log_inliers += count * math.log(1 - OUTLIER_PROBABILITY) - half * math.log(prior + squared_px)
    return log_inliers + (len(correspondences) - count) * math.log(
        OUTLIER_PROBABILITY / (OUTLIER_RANGE_SIGMAS * click_sigma_px) ** 2
    )
