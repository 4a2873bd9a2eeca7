"""Levenberg-Marquardt on the reprojection error, for many initial poses at once.

The steps are twists in camera axes about the pivot of the correspondences. This keeps long lenses well conditioned:
under them a rotation about a distant origin looks almost like a shift.
"""

from dataclasses import dataclass

import numpy as np

from ..transforms import cross_matrices, rotation_from_vector, rotation_vector
from .reprojection import Correspondences, Poses, residuals, twist_jacobians

MAX_ITERATIONS = 60
CONVERGED_PX = 1e-8
"""By how much a step that is the last one moves the projected points (root of the sum of squares)."""


@dataclass(frozen=True)
class Loss:
    """The loss rho(s) of a residual, with s its squared length.

    Attributes
    ----------
    scale_px
        Scale c of the loss of Geman and McClure, rho(s) = c^2 s / (c^2 + s): bounded by c^2, so that outliers have
        little influence. ``None``: least squares, rho(s) = s, where a point behind the camera costs infinity.
    """

    scale_px: float | None = None

    def __call__(self, squared: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """rho(s) and rho'(s) for s of any shape; NaN (behind the camera) gives the largest loss and no weight."""
        behind = np.isnan(squared)
        if self.scale_px is None:
            return np.where(behind, np.inf, squared), np.where(behind, 0.0, 1.0)
        bound = self.scale_px**2
        squared = np.where(behind, 0.0, squared)
        kept = bound / (bound + squared)
        return np.where(behind, bound, squared * kept), np.where(behind, 0.0, kept**2)


@dataclass(frozen=True)
class PosePrior:
    """A quadratic prior on the fitted poses: cost |precision_root @ d|^2 for a twist d from the prior pose.

    Attributes
    ----------
    poses
        The prior pose of each fitted one.
    precision_root
        ``(6, 6)`` px per mm and px per radian, camera axes.
    """

    poses: Poses
    precision_root: np.ndarray

    def residuals_and_jacobians(self, poses: Poses) -> tuple[np.ndarray, np.ndarray]:
        """Residuals ``(K, 6)``, prior minus current pose, and derivatives ``(K, 6, 6)`` of the latter by a twist."""
        between = poses.rotations @ np.swapaxes(self.poses.rotations, -1, -2)
        rotation_vectors = np.stack([rotation_vector(rotation) for rotation in between])
        angle = np.linalg.norm(rotation_vectors, axis=-1)[:, None, None]
        # inverse left Jacobian of SO(3): change of the rotation vector between the poses with a further rotation
        small = angle < 1e-4
        half = 0.5 * np.where(small, 1.0, angle)
        second = np.where(small, 1 / 12, (1 - half / np.tan(half)) / (4 * half**2))
        cross = cross_matrices(rotation_vectors)
        jacobian = np.zeros((len(poses), 6, 6))
        jacobian[:, :3, :3] = np.eye(3)
        jacobian[:, 3:, 3:] = np.eye(3) - 0.5 * cross + second * cross @ cross
        difference = np.concatenate([poses.positions - self.poses.positions, rotation_vectors], axis=1)
        return -difference @ self.precision_root.T, self.precision_root @ jacobian


def fit_poses(
    correspondences: Correspondences,
    start: Poses,
    *,
    loss: Loss | None = None,
    prior: PosePrior | None = None,
    free_directions: np.ndarray | None = None,
    iterations: int = MAX_ITERATIONS,
    converged_px: float = CONVERGED_PX,
) -> tuple[Poses, np.ndarray]:
    """The local minima of the reprojection error that initial poses converge to.

    Parameters
    ----------
    correspondences
        N correspondences.
    start
        K initial poses.
    loss
        Least squares if left out.
    prior
        Added to the cost if given.
    free_directions
        ``(6, D)`` orthonormal directions of the twist in which the poses may change; all six if left out.
    iterations
        Largest number of iterations.
    converged_px
        By how much a step that is the last one moves the projected points (root of the sum of squares).

    Returns
    -------
    K poses, and their costs ``(K,)`` in px^2. With least squares the cost is infinite, and the pose unchanged, where an
    initial pose has a point behind the camera.
    """
    loss = loss or Loss()
    basis = np.eye(6) if free_directions is None else free_directions
    rotations, positions = start.rotations.copy(), start.positions.copy()
    cost, normal, gradient = _normal_equations(correspondences, start, loss, prior, basis)
    damping = np.full(len(start), 1e-4)
    active = np.isfinite(cost)
    for _ in range(iterations):
        if not active.any():
            break
        now = np.flatnonzero(active)
        diagonal = np.einsum("kii->ki", normal[now])
        if prior is not None:
            # damped in the metric of the prior: directions that no pixel determines then stay instead of drifting
            metric = ((prior.precision_root @ basis) ** 2).sum(axis=0)
            diagonal = metric * (diagonal / metric).max(axis=1, keepdims=True)
        # without a floor, a direction that moves no pixel would make the system singular
        floor = 1e-12 * diagonal.max(axis=1, keepdims=True) + 1e-30
        damped = normal[now] + (damping[now, None] * diagonal + floor)[..., None] * np.eye(basis.shape[1])
        step = np.linalg.solve(damped, gradient[now][..., None])[..., 0]
        twist = step @ basis.T
        tried = Poses(rotation_from_vector(twist[:, 3:]) @ rotations[now], positions[now] + twist[:, :3])
        tried_cost, tried_normal, tried_gradient = _normal_equations(correspondences, tried, loss, prior, basis)
        better = tried_cost <= cost[now]
        moved_px = np.sqrt(np.maximum(np.einsum("ki,kij,kj->k", step, normal[now], step), 0))
        accepted = now[better]
        rotations[accepted], positions[accepted] = tried.rotations[better], tried.positions[better]
        cost[accepted], normal[accepted] = tried_cost[better], tried_normal[better]
        gradient[accepted] = tried_gradient[better]
        damping[now] = np.clip(np.where(better, damping[now] / 8, damping[now] * 6), 1e-12, None)
        active[now] = (moved_px > converged_px) & (damping[now] < 1e9)
    return Poses(_orthonormal(rotations), positions), cost


def _normal_equations(
    correspondences: Correspondences, poses: Poses, loss: Loss, prior: PosePrior | None, basis: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Costs ``(K,)``, weighted J^T J ``(K, D, D)`` and J^T r ``(K, D)``."""
    residuals_px, offsets_cam = residuals(correspondences, poses)
    costs, weights = loss((residuals_px**2).sum(axis=-1))
    jacobians = (
        np.nan_to_num(twist_jacobians(correspondences.camera, offsets_cam, poses.positions), posinf=0, neginf=0) @ basis
    )
    root = np.sqrt(weights)[..., None]
    count = len(poses)
    rows = (jacobians * root[..., None]).reshape(count, -1, basis.shape[1])
    values = (np.nan_to_num(residuals_px) * root).reshape(count, -1)
    cost = costs.sum(axis=-1)
    if prior is not None:
        prior_values, prior_rows = prior.residuals_and_jacobians(poses)
        rows = np.concatenate([rows, prior_rows @ basis], axis=1)
        values = np.concatenate([values, prior_values], axis=1)
        cost = cost + (prior_values**2).sum(axis=-1)
    across = np.swapaxes(rows, -1, -2)
    return cost, across @ rows, (across @ values[..., None])[..., 0]


def _orthonormal(rotations: np.ndarray) -> np.ndarray:
    """Remove the rounding errors of many steps: one Newton step towards the polar factor (Higham 1986)."""
    return 0.5 * rotations @ (3 * np.eye(3) - np.swapaxes(rotations, -1, -2) @ rotations)
