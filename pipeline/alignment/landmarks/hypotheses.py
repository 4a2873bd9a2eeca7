"""Explanations of the pairs: poses, each with the pairs that it takes for right, weighed against each other.

Needs ``cv2``, through :mod:`.candidates`.
"""

import math
from dataclasses import dataclass

import numpy as np

from .candidates import candidate_poses
from .levenberg_marquardt import Loss, fitted_poses
from .outliers import select_inliers
from .reprojection import Correspondences, Poses, residuals

WRONG_PAIR, WRONG_SIGMAS = 0.05, 50.0
"""Probability that a pair is wrong, before anything is known; it then lies anywhere within so many sigmas."""

DOUBTFUL = 2.0
"""A noise estimate of more than so many times the stated noise makes it worth looking for wrong pairs."""

NOISE_DOF = 12.0
"""How firmly the stated noise is believed where wrong pairs are weighed against large noise, in degrees of freedom."""

SAMPLES = 50
"""Of three pairs: with 40 % wrong pairs, the chance that none of them is free of these is 5e-6."""

KEPT, TRIED = 8, 4
START_APART_DEG, SAME_DEG = 2.0, 0.1
"""Starts nearer to each other than the first lead to one minimum; minima nearer than the second are one."""


@dataclass(frozen=True)
class Hypothesis:
    """A pose and the pairs that it explains.

    Attributes
    ----------
    pose
        One pose, fitted to the inliers by least squares.
    inliers
        ``(N,)`` bool.
    squared_px
        Sum of the squared residuals of the inliers.
    log_evidence
        Logarithm of the probability of the pairs under it, up to a constant that all hypotheses share.
    """

    pose: Poses
    inliers: np.ndarray
    squared_px: float
    log_evidence: float

    @property
    def dof(self) -> int:
        """Degrees of freedom of the residuals."""
        return 2 * int(self.inliers.sum()) - 6

    @property
    def noise_px(self) -> float:
        """What the residuals alone say of the noise in each image direction."""
        return math.sqrt(self.squared_px / self.dof)


def hypotheses(
    pairs: Correspondences, start: Poses, click_sigma_px: float, *, doubting: bool = True
) -> list[Hypothesis]:
    """What explains the pairs, the most probable first; empty if no pose puts the points in front of the camera.

    Every candidate is refined. From 5 pairs on, and unless all agree, some may be wrong: the candidates are refined
    with a bounded loss whose scale shrinks, and the best of them choose their pairs (:mod:`.outliers`).

    Parameters
    ----------
    pairs
        At least 4.
    start
        Further poses to start from, possibly none.
    doubting
        Whether any pair may be wrong.
    """
    found = candidate_poses(pairs, samples=SAMPLES if doubting else 0)
    starts = Poses(
        np.concatenate([found.rotations, start.rotations]), np.concatenate([found.positions, start.positions])
    )
    if not len(starts):
        return []
    everyone = np.ones(len(pairs), bool)
    fitted, cost = fitted_poses(pairs, _best(pairs, starts, 64 * click_sigma_px))
    trials = [(fitted[[number]], everyone) for number in np.argsort(cost) if np.isfinite(cost[number])]
    # where all pairs agree as well as clicks can, none of them is worth doubting
    agree = cost.min(initial=np.inf) <= (2 * len(pairs) - 6) * (DOUBTFUL * click_sigma_px) ** 2
    if doubting and len(pairs) > 4 and not agree:
        trials += _consensus(pairs, starts, click_sigma_px)
        inliers, pose = select_inliers(pairs, fitted[[int(np.argmin(cost))]], everyone, click_sigma_px)
        trials = [(pose, inliers), *trials[1:]]
    explained: list[Hypothesis] = []
    for pose, inliers in _different(trials):
        squared = float((residuals(pairs[inliers], pose)[0] ** 2).sum())
        if np.isfinite(squared):
            evidence = _log_evidence(pairs, inliers, squared, click_sigma_px)
            explained.append(Hypothesis(pose, inliers, squared, evidence))
    return sorted(explained, key=lambda each: -each.log_evidence)


def _consensus(pairs: Correspondences, starts: Poses, click_sigma_px: float) -> list[tuple[Poses, np.ndarray]]:
    """Poses that some of the pairs agree on, and which these are."""
    robust = _best(pairs, starts, 16 * click_sigma_px)
    for scale in (16, 4):
        robust, cost = fitted_poses(pairs, robust, loss=Loss(scale * click_sigma_px), iterations=15)
    poses = [robust[[number]] for number in np.argsort(cost, kind="stable")]
    trials = _different([(pose, _nearest_pairs(pairs, pose, 4 * click_sigma_px)) for pose in poses])[:TRIED]
    agreed = [select_inliers(pairs, pose, inliers, click_sigma_px) for pose, inliers in trials]
    return [(pose, inliers) for inliers, pose in agreed]


def _best(pairs: Correspondences, poses: Poses, scale_px: float) -> Poses:
    """The poses of lowest bounded cost, only one of those that are nearly the same."""
    squared = (residuals(pairs, poses)[0] ** 2).sum(axis=-1)
    order = np.argsort(Loss(scale_px)(squared)[0].sum(axis=1), kind="stable")
    kept: list[int] = []
    for number in order:
        if len(kept) < KEPT and not _near(poses.rotations[number], poses.rotations[kept], START_APART_DEG).any():
            kept.append(int(number))
    return poses[kept]


def _different(trials: list[tuple[Poses, np.ndarray]]) -> list[tuple[Poses, np.ndarray]]:
    """Without those that agree on the pairs, and nearly on the rotation, with an earlier one."""
    kept: list[tuple[Poses, np.ndarray]] = []
    for pose, inliers in trials:
        if not any(
            np.array_equal(inliers, others) and _near(pose.rotations[0], other.rotations, SAME_DEG).all()
            for other, others in kept
        ):
            kept.append((pose, inliers))
    return kept


def _near(rotation: np.ndarray, rotations: np.ndarray, within_deg: float) -> np.ndarray:
    """``(K,)`` bool: which of ``(K, 3, 3)`` rotations are within an angle of a ``(3, 3)`` one."""
    # |R - S|^2 = 8 sin^2(angle / 2), exact for small angles as a trace is not
    return ((rotations - rotation) ** 2).sum(axis=(1, 2)) <= 8 * np.sin(np.radians(within_deg) / 2) ** 2


def _nearest_pairs(pairs: Correspondences, pose: Poses, within_px: float) -> np.ndarray:
    """``(N,)`` bool: the pairs with residuals up to a bound, at least the 4 smallest."""
    length = np.nan_to_num(np.linalg.norm(residuals(pairs, pose)[0][0], axis=-1), nan=np.inf)
    return length <= max(within_px, float(np.sort(length)[3]))


def _log_evidence(pairs: Correspondences, inliers: np.ndarray, squared: float, click_sigma_px: float) -> float:
    """The pose and the noise integrated out: a normal of unknown variance, its prior scaled inverse chi^2.

    With n inliers, nu prior degrees of freedom and half = nu / 2 + n - 3 it is
    pi^-(n - 3) Gamma(half) (nu sigma^2)^(nu/2) (nu sigma^2 + squared)^-half, times the probability of the other pairs.
    (The volume of the pose's posterior is taken as equal for all hypotheses.)
    """
    count = int(inliers.sum())
    prior, half = NOISE_DOF * click_sigma_px**2, NOISE_DOF / 2 + count - 3
    right = -(count - 3) * math.log(math.pi) + math.lgamma(half) + NOISE_DOF / 2 * math.log(prior)
    right += count * math.log(1 - WRONG_PAIR) - half * math.log(prior + squared)
    return right + (len(pairs) - count) * math.log(WRONG_PAIR / (WRONG_SIGMAS * click_sigma_px) ** 2)
