"""Whether to trust the pose of a registered frame: the probability that it is right, and a state.

What tells right poses from wrong ones is in how many places of the image the flow agrees with the pose, whatever the
light, the blur and what covers the rest: of 389 poses found in frames of two scenes under eleven kinds of degradation,
mirrored and of other scenes, wrong ones had at most 9 blocks of 32 px that agree, and right ones rarely so few. How far
a right pose is off, its covariance says.
"""

from dataclasses import dataclass
from math import erf, exp, log, sqrt
from typing import NamedTuple

import numpy as np

from ..alignment.pose_uncertainty import PoseUncertainty
from ..alignment.reprojection import twist_jacobians
from ..camera.pinhole import PinholeCamera
from ..transforms import transform_points
from .blocks import BLOCK_PX, blocks_of, robust_step
from .flow_refinement import FITTED, FlowFit
from .localise import Localised

ACCEPTED, DOUBTFUL, REFUSED = "accepted", "doubtful", "refused"

AGREEING_PX = 1.5
"""Largest residual of a pixel whose flow agrees with the pose."""
LEAST_PIXELS, LEAST_SHARE, LEAST_LIKE = 8, 0.5, 0.5
"""Pixels that a block needs to count as a place of the image, share of them that must agree, and correlation of their
code values with the known view's: where a frame shows nothing, its flow is none, and agrees with any pose."""
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


def judge(
    fit: FlowFit | None, found: Localised | None, pivot_model: np.ndarray
) -> tuple[Verdict, PoseUncertainty | None]:
    """The verdict on a fit, and the uncertainty of its pose, about a ``(3,)`` pivot.

    ``found`` is how the frame was localised, if it was.
    """
    if fit is None:
        return Verdict(REFUSED, 0.0, _nothing(found)), None
    agrees = agreeing_blocks(fit, fit.pixels).agrees
    blocks, count = len(agrees), int(np.count_nonzero(agrees))
    uncertainty = _uncertainty(fit, pivot_model)
    probability = within(uncertainty, fit.camera) / (1 + exp(-OFFSET - SLOPE * log(1 + count)))
    reason = f"{count} of {blocks} places of the image agree with it"
    if probability >= LEAST_ACCEPTED:
        return Verdict(ACCEPTED, probability, reason), uncertainty
    state = DOUBTFUL if probability >= LEAST_DOUBTFUL else REFUSED
    return Verdict(state, probability, f"only {reason}"), uncertainty


class Blocks(NamedTuple):
    """Columns and rows ``(B, 2)`` of blocks; ``(B,)`` bool, whether enough pixels tell of it, and whether it agrees."""

    places: np.ndarray
    known: np.ndarray
    agrees: np.ndarray


def agreeing_blocks(fit: FlowFit, pixels: np.ndarray) -> Blocks:
    """Where a frame agrees with its pose: blocks in which pixels ``(N, 2)`` lie that stand for the fit's points."""
    blocks, block = blocks_of(pixels)
    count, agreeing = np.bincount(block), np.bincount(block, weights=fit.residuals_px < AGREEING_PX)
    places, known = np.zeros((blocks, 2), int), count >= LEAST_PIXELS
    places[block] = pixels // BLOCK_PX
    agrees = known & (agreeing >= LEAST_SHARE * count) & (_likeness(fit.codes, block) > LEAST_LIKE)
    return Blocks(places, known, agrees)


def _nothing(found: Localised | None) -> str:
    if found is None:
        return "it shares too few features with the aligned frame"
    return f"{found.inliers} features agree on a pose, but the image around them does not"


def _likeness(codes: np.ndarray, block: np.ndarray) -> np.ndarray:
    """The correlation in each block of code values ``(N, 2)``."""
    one, other = codes.T
    count = np.bincount(block)
    means = [np.bincount(block, weights=each) / count for each in (one, other)]
    one, other = one - means[0][block], other - means[1][block]
    together, alone, apart = (np.bincount(block, weights=each) for each in (one * other, one**2, other**2))
    return together / np.sqrt(np.maximum(alone * apart, 1e-9))


def within(uncertainty: PoseUncertainty, camera: PinholeCamera) -> float:
    """Probability that a pose is within the limits, beside the K that belongs to it."""
    uncertainty = uncertainty.at_focal_length
    depth_mm, covariance = float(uncertainty.pivot_cam[2]), uncertainty.covariance
    across_px = camera.fx / depth_mm * sqrt(max(float(np.linalg.eigvalsh(covariance[:2, :2])[-1]), 0.0))
    share = sqrt(max(float(covariance[2, 2]), 0.0)) / depth_mm
    limits = (WITHIN_DEG, uncertainty.largest_rotation_deg), (WITHIN_SHARE, share), (WITHIN_PX, across_px)
    return float(np.prod([erf(limit / max(sigma * sqrt(2), 1e-9)) for limit, sigma in limits]))


def _uncertainty(fit: FlowFit, pivot_model: np.ndarray) -> PoseUncertainty:
    used = fit.returning(FITTED)
    position = transform_points(fit.cam_from_model, pivot_model[None])
    offsets_cam = (fit.points_model[used] - pivot_model) @ fit.cam_from_model[:3, :3].T
    jacobian = twist_jacobians(fit.camera, offsets_cam[None], position)[0]
    residuals = fit.moved[used] - fit.camera.project(offsets_cam + position)
    _, covariance = robust_step(jacobian, residuals, fit.pixels[used])
    return PoseUncertainty.about_points(pivot_model, covariance, fit.points_model, fit.cam_from_model)
