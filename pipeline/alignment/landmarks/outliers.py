"""Which pairs are wrong: each is compared with what the others predict for it."""

import numpy as np

from .confidence_region import f_survival
from .covariance import NoiseEstimate, inverse_normal
from .levenberg_marquardt import fitted_poses
from .reprojection import Correspondences, Poses, residuals, twist_jacobians

FALSE_ALARM = 0.01
"""Probability that of all pairs, none of them wrong, any is called wrong."""

ROUNDS = 10


def select_inliers(
    pairs: Correspondences, pose: Poses, inliers: np.ndarray, click_sigma_px: float
) -> tuple[np.ndarray, Poses]:
    """Fit the pairs that agree, until no pair left out belongs to them and none of them stands out.

    Parameters
    ----------
    pairs
        All N pairs.
    pose
        One pose to start from.
    inliers
        ``(N,)`` bool, a first guess; at least 4.
    click_sigma_px
        Stated click noise.

    Returns
    -------
    ``(N,)`` bool and the pose that fits these pairs best.
    """
    seen: set[bytes] = set()
    pose, _ = fitted_poses(pairs[inliers], pose)
    while len(seen) < ROUNDS and inliers.tobytes() not in seen:
        seen.add(inliers.tobytes())
        chances = residual_p_values(pairs, pose, inliers, click_sigma_px)
        unlikely = chances < FALSE_ALARM / len(pairs)
        # one at a time: a wrong pair makes its neighbours look wrong; and never below the 4 that a pose needs
        worst = int(np.argmin(np.where(inliers, chances, np.inf)))
        changed = inliers.copy()
        if unlikely[worst] and inliers.sum() > 4:
            changed[worst] = False
        elif (back := ~inliers & ~unlikely).any():
            changed[int(np.argmax(np.where(back, chances, -1)))] = True
        else:
            break
        inliers = changed
        pose, _ = fitted_poses(pairs[inliers], pose)
    return inliers, pose


def residual_p_values(pairs: Correspondences, pose: Poses, inliers: np.ndarray, click_sigma_px: float) -> np.ndarray:
    """``(N,)`` probability of a residual as large as each pair's, were the pair right.

    A pair that took part pulls the pose towards itself: its residual is divided by what is left of the noise after
    that, (1 - H), and the noise is estimated without it (externally studentised, Cook & Weisberg 1982). One that did
    not take part has the uncertainty of its prediction added, (1 + H). H = J (sum J^T J)^-1 J^T; r^T (1 -+ H)^-1 r / 2
    over the noise follows F(2, dof). 0 for points behind the camera.
    """
    apart, turned = residuals(pairs, pose)
    apart, jacobians = apart[0], twist_jacobians(pairs.camera, turned, pose.positions)[0]
    normal = inverse_normal(jacobians[inliers].reshape(-1, 6))
    leverage = jacobians @ normal @ np.swapaxes(jacobians, -1, -2)
    spread = np.eye(2) + np.where(inliers, -1.0, 1.0)[:, None, None] * leverage
    total, dof = float((apart[inliers] ** 2).sum()), 2 * int(inliers.sum()) - 6
    visible = np.isfinite(apart).all(axis=1)
    values, vectors = np.linalg.eigh(np.where(visible[:, None, None], spread, np.eye(2)))
    # a direction that this pair alone determines: it cannot contradict the others there
    along = (np.nan_to_num(apart)[:, None] @ vectors)[:, 0]
    squared = np.where(values > 1e-6, along**2 / np.maximum(values, 1e-6), 0).sum(axis=1)
    chances = np.zeros(len(pairs))
    for index in np.flatnonzero(visible):
        without, less = (float(squared[index]), 2) if inliers[index] else (0.0, 0)
        noise = NoiseEstimate.of(max(total - without, 0.0), dof - less, click_sigma_px)
        chances[index] = f_survival(float(squared[index]) / (2 * noise.variance), 2, noise.dof)
    return chances
