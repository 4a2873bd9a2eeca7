"""Whether to trust the pose of a registered frame: the probability that it is right, and a state.

What tells right poses from wrong ones is in how many places of the image the flow agrees with the pose, whatever the
light, the blur and what covers the rest: of 389 poses found in frames of two scenes under eleven kinds of degradation,
mirrored and of other scenes, wrong ones had at most 9 blocks of 32 px that agree, and right ones rarely so few. How far
a right pose is off, its covariance says.
"""

from dataclasses import dataclass
from math import erf, exp, log, sqrt

import numpy as np

from ..alignment.reprojection import twist_jacobians
from ..transforms import transform_points
from .flow_refinement import FlowFit
from .localise import Localised

ACCEPTED, DOUBTFUL, REFUSED = "accepted", "doubtful", "refused"

AGREEING_PX = 1.5
"""Largest residual of a pixel whose flow agrees with the pose."""
BLOCK_PX, LEAST_PIXELS, LEAST_SHARE = 32, 8, 0.5
"""Side of the blocks of the image that agree or not and count as independent, pixels that a block needs, and share of
them that must agree."""
SPREAD = 3.0
"""Factor of the standard deviations: neighbouring blocks, the surface and the aligned frame err together. Errors were 2
times as large as without it on eight frames of the sample, 3 to 5 times on 39 of "bloster", whose mesh is off by
millimetres."""
OFFSET, SLOPE = -10.6, 5.46
"""Logistic regression of the 389 poses on log(1 + agreeing blocks)."""
WITHIN_DEG, WITHIN_SHARE, WITHIN_PX = 2.0, 0.02, 5.0
"""What a right pose is within: rotation, share of the distance, and mean place in the image."""
LEAST_ACCEPTED, LEAST_DOUBTFUL = 0.97, 0.5


@dataclass(frozen=True)
class Verdict:
    """What to think of a pose.

    Attributes
    ----------
    state
        :data:`ACCEPTED`, :data:`DOUBTFUL` or :data:`REFUSED`.
    probability
        That the pose is within 2°, 2 % of the distance and 5 px of what the aligned frame's pose says, 0..1.
    reason
        A short sentence.
    """

    state: str
    probability: float
    reason: str


def judge(fit: FlowFit | None, found: Localised | None, pivot_model: np.ndarray) -> tuple[Verdict, np.ndarray | None]:
    """The verdict on a fit, and its ``(6, 6)`` covariance about a ``(3,)`` pivot, mm and radians in camera axes.

    ``found`` is how the frame was localised, if it was.
    """
    if fit is None:
        return Verdict(REFUSED, 0.0, _nothing(found)), None
    agrees = fit.residuals_px < AGREEING_PX
    blocks, block = _blocks(fit.pixels)
    pixels, agreeing = np.bincount(block), np.bincount(block, weights=agrees)
    count = int(np.count_nonzero((pixels >= LEAST_PIXELS) & (agreeing >= LEAST_SHARE * pixels)))
    covariance = _covariance(fit, pivot_model)
    probability = 1 / (1 + exp(-OFFSET - SLOPE * log(1 + count))) * _within(fit, covariance, pivot_model)
    reason = f"{count} of {blocks} places of the image agree with it"
    if probability >= LEAST_ACCEPTED:
        return Verdict(ACCEPTED, probability, reason), covariance
    state = DOUBTFUL if probability >= LEAST_DOUBTFUL else REFUSED
    return Verdict(state, probability, f"only {reason}"), covariance


def _nothing(found: Localised | None) -> str:
    if found is None:
        return "it shares too few features with the aligned frame"
    return f"{found.inliers} features agree on a pose, but the image around them does not"


def _blocks(pixels: np.ndarray) -> tuple[int, np.ndarray]:
    """How many blocks pixels ``(N, 2)`` lie in, and ``(N,)`` the number of each one's."""
    found, block = np.unique((pixels // BLOCK_PX).astype(int), axis=0, return_inverse=True)
    return len(found), block.ravel()


def _within(fit: FlowFit, covariance: np.ndarray, pivot_model: np.ndarray) -> float:
    """Probability that a pose of this covariance is within the limits."""
    depth_mm = float(transform_points(fit.cam_from_model, pivot_model[None])[0, 2])
    rotation_deg = np.degrees(sqrt(max(float(np.linalg.eigvalsh(covariance[3:, 3:])[-1]), 0.0)))
    across_px = fit.view.camera.fx / depth_mm * sqrt(max(float(np.linalg.eigvalsh(covariance[:2, :2])[-1]), 0.0))
    share = sqrt(max(float(covariance[2, 2]), 0.0)) / depth_mm
    limits = (WITHIN_DEG, rotation_deg), (WITHIN_SHARE, share), (WITHIN_PX, across_px)
    return float(np.prod([erf(limit / max(sigma * sqrt(2), 1e-9)) for limit, sigma in limits]))


def _covariance(fit: FlowFit, pivot_model: np.ndarray) -> np.ndarray:
    """``(6, 6)`` covariance of a fit's twist, robust against errors shared within a block (Liang & Zeger 1986)."""
    used = np.isfinite(fit.residuals_px)
    points, moved = fit.points_model[used], fit.moved[used]
    position = transform_points(fit.cam_from_model, pivot_model[None])[0]
    offsets_cam = (points - pivot_model) @ fit.cam_from_model[:3, :3].T
    jacobian = twist_jacobians(fit.view.camera, offsets_cam[None], position[None])[0]
    residuals = moved - fit.view.camera.project(offsets_cam + position)
    # far residuals have little weight, as in the fit
    weight = 1 / (1 + (residuals**2).sum(axis=1)) ** 2
    normal = np.einsum("nci,ncj,n->ij", jacobian, jacobian, weight)
    gradient = np.einsum("nci,nc,n->ni", jacobian, residuals, weight)
    count, block = _blocks(fit.pixels[used])
    sums = np.zeros((count, 6))
    np.add.at(sums, block, gradient)
    # mm and radians differ in size
    scale = 1 / np.sqrt(np.maximum(np.diag(normal), 1e-300))
    inverse = scale[:, None] * np.linalg.pinv(scale[:, None] * normal * scale, hermitian=True) * scale
    return SPREAD**2 * inverse @ (sums.T @ sums) @ inverse
