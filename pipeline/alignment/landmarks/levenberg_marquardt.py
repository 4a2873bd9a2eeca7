"""Levenberg-Marquardt on the reprojection error, for many starting poses at once.

The steps are twists in camera axes about the pivot of the pairs, so a long lens (where a turn about the model's origin
is all but a shift) is as well conditioned as a short one.
"""

from dataclasses import dataclass

import numpy as np

from ...transforms import cross_matrices, rotation_from_vector, rotation_vector
from .reprojection import Correspondences, Poses, residuals, twist_jacobians

ITERATIONS = 60
CONVERGED = 1e-8
"""A step that moves no point by more than this many pixels ends the iteration."""


@dataclass(frozen=True)
class Loss:
    """What a residual costs.

    Attributes
    ----------
    scale_px
        Scale c of Geman and McClure's rho(s) = c2 s / (c2 + s), s the squared length of a residual: bounded by c2, so
        that a wrong pair cannot pull. ``None``: rho(s) = s, least squares; a point behind the camera is then ruled out.
    """

    scale_px: float | None = None

    def __call__(self, squared: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Cost and weight of squared residuals; NaN (behind the camera) costs as much as anything can."""
        behind = np.isnan(squared)
        if self.scale_px is None:
            return np.where(behind, np.inf, squared), np.where(behind, 0.0, 1.0)
        bound = self.scale_px**2
        squared = np.where(behind, 0.0, squared)
        kept = bound / (bound + squared)
        return np.where(behind, bound, squared * kept), np.where(behind, 0.0, kept**2)


@dataclass(frozen=True)
class Held:
    """A pull towards poses, in pixels: cost |precision_root @ twist from there|^2.

    Attributes
    ----------
    poses
        Where to, one for each pose that is fitted.
    precision_root
        ``(6,)`` px per mm and px per radian, along the camera's axes.
    """

    poses: Poses
    precision_root: np.ndarray

    def terms(self, poses: Poses) -> tuple[np.ndarray, np.ndarray]:
        """Residuals ``(K, 6)`` (held minus present) and their Jacobian ``(K, 6, 6)`` with the sign of a prediction."""
        between = poses.rotations @ np.swapaxes(self.poses.rotations, -1, -2)
        turn = np.stack([rotation_vector(rotation) for rotation in between])
        angle = np.linalg.norm(turn, axis=-1)[:, None, None]
        # inverse left Jacobian of SO(3): how the rotation vector between the poses grows with a further turn
        small = angle < 1e-4
        half = 0.5 * np.where(small, 1.0, angle)
        second = np.where(small, 1 / 12, (1 - half / np.tan(half)) / (4 * half**2))
        cross = cross_matrices(turn)
        jacobian = np.zeros((len(poses), 6, 6))
        jacobian[:, :3, :3] = np.eye(3)
        jacobian[:, 3:, 3:] = np.eye(3) - 0.5 * cross + second * cross @ cross
        apart = np.concatenate([poses.positions - self.poses.positions, turn], axis=1)
        return -apart * self.precision_root, jacobian * self.precision_root[:, None]


def fitted_poses(
    pairs: Correspondences,
    start: Poses,
    *,
    loss: Loss | None = None,
    held: Held | None = None,
    freedoms: np.ndarray | None = None,
    iterations: int = ITERATIONS,
) -> tuple[Poses, np.ndarray]:
    """The local minima of the reprojection error that the starting poses lead to.

    Parameters
    ----------
    pairs
        N pairs.
    start
        K poses.
    loss
        Least squares if left out.
    held
        Adds a pull towards poses.
    freedoms
        ``(6, D)`` orthonormal directions of the twist that may change; all six if left out.
    iterations
        At most so many; few are enough to leave a bad start.

    Returns
    -------
    K poses and their costs ``(K,)`` in px^2; infinite where least squares found a point behind the camera at the start.
    """
    loss = loss or Loss()
    basis = np.eye(6) if freedoms is None else freedoms
    rotations, positions = start.rotations.copy(), start.positions.copy()
    cost, normal, gradient = _normal_equations(pairs, start, loss, held, basis)
    damping = np.full(len(start), 1e-4)
    active = np.isfinite(cost)
    for _ in range(iterations):
        if not active.any():
            break
        now = np.flatnonzero(active)
        diagonal = np.einsum("kii->ki", normal[now])
        if held is not None:
            # damped in the measure of the pull: what no pixel determines then stays, instead of drifting along
            measure = ((held.precision_root[:, None] * basis) ** 2).sum(axis=0)
            diagonal = measure * (diagonal / measure).max(axis=1, keepdims=True)
        # a freedom that moves no pixel gets a floor, or the system would be singular
        floor = 1e-12 * diagonal.max(axis=1, keepdims=True) + 1e-30
        damped = normal[now] + (damping[now, None] * diagonal + floor)[..., None] * np.eye(basis.shape[1])
        step = np.linalg.solve(damped, gradient[now][..., None])[..., 0]
        twist = step @ basis.T
        tried = Poses(rotation_from_vector(twist[:, 3:]) @ rotations[now], positions[now] + twist[:, :3])
        tried_cost, tried_normal, tried_gradient = _normal_equations(pairs, tried, loss, held, basis)
        better = tried_cost <= cost[now]
        moved_px = np.sqrt(np.maximum(np.einsum("ki,kij,kj->k", step, normal[now], step), 0))
        accepted = now[better]
        rotations[accepted], positions[accepted] = tried.rotations[better], tried.positions[better]
        cost[accepted], normal[accepted] = tried_cost[better], tried_normal[better]
        gradient[accepted] = tried_gradient[better]
        damping[now] = np.clip(np.where(better, damping[now] / 8, damping[now] * 6), 1e-12, None)
        active[now] = (moved_px > CONVERGED) & (damping[now] < 1e9)
    return Poses(_orthonormal(rotations), positions), cost


def _normal_equations(
    pairs: Correspondences, poses: Poses, loss: Loss, held: Held | None, basis: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Costs ``(K,)``, weighted J^T J ``(K, D, D)`` and J^T r ``(K, D)``."""
    apart, turned = residuals(pairs, poses)
    costs, weights = loss((apart**2).sum(axis=-1))
    jacobians = np.nan_to_num(twist_jacobians(pairs.camera, turned, poses.positions), posinf=0, neginf=0) @ basis
    root = np.sqrt(weights)[..., None]
    count, freedoms = len(poses), basis.shape[1]
    rows = (jacobians * root[..., None]).reshape(count, -1, freedoms)
    values = (np.nan_to_num(apart) * root).reshape(count, -1)
    cost = costs.sum(axis=-1)
    if held is not None:
        held_values, held_rows = held.terms(poses)
        rows = np.concatenate([rows, held_rows @ basis], axis=1)
        values = np.concatenate([values, held_values], axis=1)
        cost = cost + (held_values**2).sum(axis=-1)
    across = np.swapaxes(rows, -1, -2)
    return cost, across @ rows, (across @ values[..., None])[..., 0]


def _orthonormal(rotations: np.ndarray) -> np.ndarray:
    """Rounding of many steps taken out: one step of Newton's iteration for the polar factor (Higham 1986)."""
    return 0.5 * rotations @ (3 * np.eye(3) - np.swapaxes(rotations, -1, -2) @ rotations)
