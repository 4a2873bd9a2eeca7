"""Hypotheses: poses, each with its inliers and its probability given the correspondences. Needs ``cv2``.

Initial poses are closed-form solutions from all correspondences and from samples of three. Inliers are selected by
testing each correspondence against the prediction of the others.
"""

import itertools
import math
from collections.abc import Iterator
from dataclasses import dataclass

import cv2
import numpy as np

from ..confidence_region import f_survival
from ..levenberg_marquardt import Loss, fit_poses
from ..reprojection import Correspondences, Poses, residuals, twist_jacobians
from .covariance import SELECTION_PRIOR_DOF, NoiseEstimate, inverse_normal_matrix

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

UNDISTORTED = np.zeros(4)
"""Distortion coefficients for OpenCV: none."""

FALSE_ALARM_PROBABILITY = 0.01
"""Probability that any of the correspondences is called an outlier although none is."""

MAX_ROUNDS = 10
"""Each round adds or removes one correspondence."""


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
    inliers (:func:`select_inliers`).

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


def candidate_poses(correspondences: Correspondences, samples: int) -> Poses:
    """Candidate poses that see more than half of the points in front of the camera.

    From all correspondences: SQPnP (Terzakis & Lourakis 2020), EPnP (Lepetit et al. 2009), and both solutions of IPPE
    (Collins & Bartoli 2014) for the points projected onto their best-fit plane. IPPE finds both minima of points that
    are coplanar or nearly so. From samples of three correspondences: up to four AP3P solutions each (Ke & Roumeliotis
    2017), which do not depend on any other correspondence being right.

    The solvers for all correspondences run from 4 on; ``samples`` is the largest number of samples of three.
    """
    found = list(_from_all_correspondences(correspondences))
    for sample in _triples(len(correspondences), samples):
        found += _opencv_solutions(correspondences[sample], cv2.SOLVEPNP_AP3P)
    rotations = np.array([rotation for rotation, _ in found]).reshape(-1, 3, 3)
    positions = np.array([position for _, position in found]).reshape(-1, 3)
    depths = rotations[:, 2] @ correspondences.offsets.T + positions[:, 2:]
    # for degenerate points some solvers return matrices that are not rotations
    deviation = np.abs(rotations @ np.swapaxes(rotations, 1, 2) - np.eye(3)).max(axis=(1, 2))
    return Poses(rotations, positions)[((depths > 0).mean(axis=1) > 0.5) & (deviation < 1e-6)]


def _from_all_correspondences(correspondences: Correspondences) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    if len(correspondences) >= 4:
        yield from _opencv_solutions(correspondences, cv2.SOLVEPNP_SQPNP)
        yield from _opencv_solutions(correspondences, cv2.SOLVEPNP_EPNP)
        centre = correspondences.offsets.mean(axis=0)
        _, _, axes = np.linalg.svd(correspondences.offsets - centre)
        axes[2] *= np.linalg.det(axes)
        flat = (correspondences.offsets - centre) @ axes.T
        flat[:, 2] = 0
        for rotation, position in _opencv_solutions(
            Correspondences(flat, correspondences.pixels, correspondences.camera, centre), cv2.SOLVEPNP_IPPE
        ):
            from_model = rotation @ axes
            yield from_model, position - from_model @ centre


def _triples(count: int, samples: int) -> Iterator[list[int]]:
    """At most ``samples`` triples of indices below ``count``; deterministic for a given ``count``."""
    triples = list(itertools.combinations(range(count), 3))
    if len(triples) > samples:
        chosen = np.random.default_rng(count).choice(len(triples), samples, replace=False)
        triples = [triples[index] for index in sorted(chosen)]
    yield from (list(triple) for triple in triples)


def _opencv_solutions(correspondences: Correspondences, method: int) -> list[tuple[np.ndarray, np.ndarray]]:
    """``(3, 3)`` rotations and ``(3,)`` positions from one of OpenCV's solvers; empty where it fails."""
    try:
        if len(correspondences) == 3:
            _, rotation_vectors, translations = cv2.solveP3P(
                correspondences.offsets, correspondences.pixels, correspondences.camera.k, UNDISTORTED, flags=method
            )
        else:
            _, rotation_vectors, translations, _ = cv2.solvePnPGeneric(
                correspondences.offsets, correspondences.pixels, correspondences.camera.k, UNDISTORTED, flags=method
            )
    except cv2.error:
        # degenerate points; another solver may succeed, and check_fit refuses what none can solve
        return []
    return [
        (cv2.Rodrigues(rotation_vector)[0], np.ravel(translation))
        for rotation_vector, translation in zip(rotation_vectors, translations, strict=True)
        if np.isfinite(rotation_vector).all() and np.isfinite(translation).all()
    ]


def select_inliers(
    correspondences: Correspondences, pose: Poses, inliers: np.ndarray, click_sigma_px: float
) -> tuple[np.ndarray, Poses]:
    """Add and remove inliers one at a time and refit, until no p-value contradicts the selection.

    Begins with one pose, and ``(N,)`` bool ``inliers``: a first guess of at least 4.

    Returns
    -------
    ``(N,)`` bool inliers, and the pose that fits them best.
    """
    seen: set[bytes] = set()
    pose, _ = fit_poses(correspondences[inliers], pose)
    while len(seen) < MAX_ROUNDS and inliers.tobytes() not in seen:
        seen.add(inliers.tobytes())
        p_values = residual_p_values(correspondences, pose, inliers, click_sigma_px)
        unlikely = p_values < FALSE_ALARM_PROBABILITY / len(correspondences)
        # one at a time, since an outlier makes its neighbours look wrong; a pose needs 4
        worst = int(np.argmin(np.where(inliers, p_values, np.inf)))
        changed = inliers.copy()
        if unlikely[worst] and inliers.sum() > 4:
            changed[worst] = False
        elif (back := ~inliers & ~unlikely).any():
            changed[int(np.argmax(np.where(back, p_values, -1)))] = True
        else:
            break
        inliers = changed
        pose, _ = fit_poses(correspondences[inliers], pose)
    return inliers, pose


def residual_p_values(
    correspondences: Correspondences, pose: Poses, inliers: np.ndarray, click_sigma_px: float
) -> np.ndarray:
    """``(N,)`` residual p-values: probability of a residual at least this large if the correspondence is right.

    Points behind the camera get 0.

    Of all N correspondences; the pose is fitted to the ``(N,)`` bool ``inliers``.

    Notes
    -----
    Let r be a residual, H = J (sum J^T J)^-1 J^T its leverage with the sum over the inliers, and sigma^2 the noise
    variance. Then r^T (1 -+ H)^-1 r / (2 sigma^2) follows F(2, dof), with - for inliers and + for the others.
    An inlier pulls the pose towards itself, so its residual is smaller than the noise, and sigma^2 is estimated without
    it (externally studentised residuals, Cook & Weisberg 1982). For the others the uncertainty of the prediction is
    added.
    """
    residual_px, offsets_cam = residuals(correspondences, pose)
    residual_px, jacobians = residual_px[0], twist_jacobians(correspondences.camera, offsets_cam, pose.positions)[0]
    normal = inverse_normal_matrix(jacobians[inliers].reshape(-1, 6))
    leverage = jacobians @ normal @ np.swapaxes(jacobians, -1, -2)
    spread = np.eye(2) + np.where(inliers, -1.0, 1.0)[:, None, None] * leverage
    total, dof = float((residual_px[inliers] ** 2).sum()), 2 * int(inliers.sum()) - 6
    visible = np.isfinite(residual_px).all(axis=1)
    values, vectors = np.linalg.eigh(np.where(visible[:, None, None], spread, np.eye(2)))
    # in a direction that one correspondence alone determines, it cannot contradict the others
    along = (np.nan_to_num(residual_px)[:, None] @ vectors)[:, 0]
    squared = np.where(values > 1e-6, along**2 / np.maximum(values, 1e-6), 0).sum(axis=1)
    p_values = np.zeros(len(correspondences))
    for index in np.flatnonzero(visible):
        without, less = (float(squared[index]), 2) if inliers[index] else (0.0, 0)
        noise = NoiseEstimate.of(max(total - without, 0.0), dof - less, click_sigma_px, SELECTION_PRIOR_DOF)
        p_values[index] = f_survival(float(squared[index]) / (2 * noise.variance), 2, noise.dof)
    return p_values
