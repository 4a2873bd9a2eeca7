"""Inlier selection: each correspondence is tested against the prediction of the others."""

import numpy as np

from ..confidence_region import f_survival
from ..levenberg_marquardt import fit_poses
from ..reprojection import Correspondences, Poses, residuals, twist_jacobians
from .covariance import SELECTION_PRIOR_DOF, NoiseEstimate, inverse_normal_matrix

FALSE_ALARM_PROBABILITY = 0.01
"""Probability that any of the correspondences is called an outlier although none is."""

MAX_ROUNDS = 10
"""Each round adds or removes one correspondence."""


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
