"""Whether to trust the pose of a registered frame: the probability that it is right, and a state.

What tells right poses from wrong ones is in how many places of the image the flow agrees with the pose, whatever the
light, the blur and what covers the rest: of 389 poses found in frames of two scenes under eleven kinds of degradation,
mirrored and of other scenes, wrong ones had at most 9 blocks of 32 px that agree, and right ones rarely so few. How far
a right pose is off, its covariance says.

Places are blocks of the image: pixels err together within one, and independently of those in others. In a film they
also tell what has changed, as bone that is drilled: a place has if it agreed first, and not to the end, in frames that
look from the same side. Instruments, blood and glare come and go; where a surface is steep, agreement comes and goes
with the direction of view.
"""

from dataclasses import dataclass
from math import erf, exp, log, sqrt
from typing import NamedTuple

import cv2
import numpy as np

from ..alignment.pose_uncertainty import PoseUncertainty
from ..alignment.reprojection import jacobian_at
from ..camera.pinhole import PinholeCamera
from ..transforms import camera_centre, transform_points
from .flow_refinement import FITTED, FlowFit
from .known_views import Localised

BLOCK_PX = 32
"""Side of a block."""

SPREAD = 3.0
"""Factor of the standard deviations: neighbouring blocks, the surface and the aligned frame err together. Errors were 2
times as large as without it on eight frames of the sample, 3 to 5 times on 39 of "bloster", whose mesh is off by
millimetres."""


def blocks_of(pixels: np.ndarray) -> tuple[int, np.ndarray]:
    """How many blocks pixels ``(N, 2)`` lie in, and ``(N,)`` the number of each one's."""
    u, v = (pixels // BLOCK_PX).astype(int).T
    # one number a block: unique rows take ten times as long
    found, block = np.unique((v << 32) + u, return_inverse=True)
    return len(found), block


def robust_step(jacobian: np.ndarray, residuals: np.ndarray, pixels: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """A step of a fit, and its covariance, robust against errors shared within a block (Liang & Zeger 1986).

    Parameters
    ----------
    jacobian, residuals
        ``(N, 2, D)`` derivatives of predicted pixels by D parameters, and ``(N, 2)`` found minus predicted, px.
    pixels
        ``(N, 2)`` where they lie.

    Returns
    -------
    ``(D,)`` and ``(D, D)``.
    """
    # far residuals have little weight, as in the fit
    weight = 1 / (1 + (residuals**2).sum(axis=1)) ** 2
    weighted = jacobian * weight[:, None, None]
    normal = np.tensordot(weighted, jacobian, ((0, 1), (0, 1)))
    gradient = (weighted * residuals[:, :, None]).sum(axis=1)
    _, block = blocks_of(pixels)
    sums = np.stack([np.bincount(block, each) for each in gradient.T], axis=1)
    inverse = _inverse(normal)
    return inverse @ gradient.sum(axis=0), SPREAD**2 * inverse @ (sums.T @ sums) @ inverse


def shared_covariance(jacobian: np.ndarray, pixels: np.ndarray) -> np.ndarray:
    """The ``(D, D)`` covariance of a fit in which each block is off as a whole by 1 px each way, by geometry alone.

    Parameters as for :func:`robust_step`.
    """
    blocks, block = blocks_of(pixels)
    sums = np.zeros((blocks, *jacobian.shape[1:]))
    np.add.at(sums, block, jacobian)
    inverse = _inverse(np.tensordot(jacobian, jacobian, ((0, 1), (0, 1))))
    return inverse @ np.tensordot(sums, sums, ((0, 1), (0, 1))) @ inverse


def _inverse(normal: np.ndarray) -> np.ndarray:
    # mm and radians differ in size
    scale = 1 / np.sqrt(np.maximum(np.diag(normal), 1e-300))
    return scale[:, None] * np.linalg.pinv(scale[:, None] * normal * scale, hermitian=True) * scale


ACCEPTED, DOUBTFUL, REFUSED = "accepted", "doubtful", "refused"
COLOURS = {ACCEPTED: (70, 180, 90), DOUBTFUL: (230, 180, 40), REFUSED: (210, 60, 50)}
"""State of a frame -> its colour in pictures, sRGB."""

AGREEING_PX = 1.5
"""Largest residual of a pixel whose flow agrees with the pose."""
LEAST_PIXELS, LEAST_SHARE, LEAST_LIKE, MOST_UNLIKE = 8, 0.5, 0.5, 0.42
"""Pixels that a block needs to count as a place of the image, share of them that must agree, and correlation of their
code values with the known view's: where a frame shows nothing, its flow is none, and agrees with any pose. A block
differs if it is less alike than the last, wherever the flow leads; all others tell nothing."""
OFFSET, SLOPE = -10.6, 5.46
"""Logistic regression of the 389 poses on log(1 + agreeing blocks)."""
BLURRED = 1.2
"""Factor of the standard deviations of a pose, over the share of its pixels whose flow comes back: the less of them do,
the more do the others err together. With it the 95 % region has 9 of 10 poses of a real endoscopy, without it 4.
Probabilities were calibrated without it."""
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
        That the pose is within 2°, 2 % of the distance and 5 px of what the aligned frame's pose says, with the zoom as
        the case's, 0..1.
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
    uncertainty = uncertainty.widened(BLURRED / float(np.isfinite(fit.residuals_px).mean()))
    reason = f"{count} of {blocks} places of the image agree with it"
    if probability >= LEAST_ACCEPTED:
        return Verdict(ACCEPTED, probability, reason), uncertainty
    state = DOUBTFUL if probability >= LEAST_DOUBTFUL else REFUSED
    return Verdict(state, probability, f"only {reason}"), uncertainty


class Blocks(NamedTuple):
    """Columns and rows ``(B, 2)`` of blocks; ``(B,)`` bool: it agrees, or it differs; others tell nothing."""

    places: np.ndarray
    agrees: np.ndarray
    differs: np.ndarray


def agreeing_blocks(fit: FlowFit, pixels: np.ndarray) -> Blocks:
    """Where a frame agrees with its pose: blocks in which pixels ``(N, 2)`` lie that stand for the fit's points."""
    blocks, block = blocks_of(pixels)
    count, agreeing = np.bincount(block), np.bincount(block, weights=fit.residuals_px < AGREEING_PX)
    places, known = np.zeros((blocks, 2), int), count >= LEAST_PIXELS
    places[block] = pixels // BLOCK_PX
    likeness = _likeness(fit.codes, block)
    # where it looks alike elsewhere, as on smooth tissue, the flow has slipped
    agrees = known & (likeness > LEAST_LIKE) & (agreeing >= LEAST_SHARE * count)
    return Blocks(places, agrees, known & (likeness < MOST_UNLIKE))


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
    """Probability that a pose is within the limits."""
    depth_mm, covariance = float(uncertainty.pivot_cam[2]), uncertainty.covariance
    across_px = camera.fx / depth_mm * sqrt(max(float(np.linalg.eigvalsh(covariance[:2, :2])[-1]), 0.0))
    share = sqrt(max(float(covariance[2, 2]), 0.0)) / depth_mm
    limits = (WITHIN_DEG, uncertainty.largest_rotation_deg), (WITHIN_SHARE, share), (WITHIN_PX, across_px)
    return float(np.prod([erf(limit / max(sigma * sqrt(2), 1e-9)) for limit, sigma in limits]))


def _uncertainty(fit: FlowFit, pivot_model: np.ndarray) -> PoseUncertainty:
    used = fit.returning(FITTED)
    points, pose = fit.points_model[used], fit.cam_from_model
    residuals_px = fit.moved[used] - fit.camera.project(transform_points(pose, points))
    jacobian = jacobian_at(points, fit.camera, pose, pivot_model)
    _, covariance = robust_step(jacobian, residuals_px, fit.pixels[used])
    return PoseUncertainty.about_points(pivot_model, covariance, fit.points_model, pose)


MOST_FRAMES = 300
"""That are compared: of more, evenly chosen ones."""
LEAST_FRAMES, LEAST_GONE = 4, 0.15
"""That agree first; and that no longer do, also as a share of the film."""
SAME_SIDE_DEG = 6.0
LEAST_PLACES = 4
"""Adjacent places without which it is chance."""
UNKNOWN, AGREES, DIFFERS = 0, 1, 2


@dataclass(frozen=True)
class FilmChange:
    """What a film no longer shows.

    Attributes
    ----------
    since
        Number of the first frame in which some of it has changed.
    share
        Share of the blocks of the aligned frame's image that have changed at the end, of those that the film shows,
        0..1.
    blocks
        ``(h, w)`` bool: which have, rows and columns of the aligned frame's blocks.
    """

    since: int
    share: float
    blocks: np.ndarray

    def words(self) -> str:
        """What to think of it."""
        return (
            f"from frame {self.since} on, {self.share:.0%} of what the case's frame shows no longer looks as it did: "
            "is bone being removed? Depths and structures there are those before; no later frame gives colour"
        )


class FilmAgreement:
    """Collects where the frames of a film agree with an aligned frame."""

    def __init__(self, camera: PinholeCamera, cam_from_model: np.ndarray, pivot_model: np.ndarray) -> None:
        """Prepare the aligned frame's camera and pose ``(4, 4)``, and the ``(3,)`` middle of what it shows, mm."""
        self._camera, self._pose, self._pivot = camera, cam_from_model, pivot_model
        self._shape = -(-camera.height // BLOCK_PX), -(-camera.width // BLOCK_PX)
        self._numbers, self._sides, self._maps = list[int](), list[np.ndarray](), list[np.ndarray]()

    def add(self, number: int, fit: FlowFit) -> None:
        """Add a frame that is accepted."""
        pixels = self._camera.project(transform_points(self._pose, fit.points_model))
        places, agrees, differs = agreeing_blocks(fit, np.clip(pixels, 0, np.array(self._camera.size_wh) - 1))
        shown, (column, row) = np.full(self._shape, UNKNOWN, np.uint8), places.T
        shown[row, column] = np.select([agrees, differs], [AGREES, DIFFERS], UNKNOWN)
        side = camera_centre(fit.cam_from_model) - self._pivot
        self._numbers.append(number)
        self._sides.append(side / np.linalg.norm(side))
        self._maps.append(shown)

    def change(self) -> FilmChange | None:
        """What has changed at the end, if anything has."""
        chosen = slice(None, None, max(1, -(-len(self._maps) // MOST_FRAMES)))
        numbers, sides, maps = self._numbers[chosen], np.array(self._sides[chosen]), np.array(self._maps[chosen])
        least = max(LEAST_FRAMES, int(np.ceil(LEAST_GONE * len(maps))))
        if len(maps) < LEAST_FRAMES + least:
            return None
        near = sides @ sides.T > np.cos(np.radians(SAME_SIDE_DEG))
        agrees, differs = ((maps == each).reshape(len(maps), -1) for each in (AGREES, DIFFERS))
        # after the last frame that agrees
        last = len(maps) - 1 - np.argmax(agrees[::-1], axis=0)
        order = np.arange(len(maps))[:, None]
        differs &= (order > last) & (agrees.sum(axis=0) >= LEAST_FRAMES)
        seen_alike = differs & (near.astype(np.float32) @ agrees > 0)
        changed = (seen_alike.sum(axis=0) >= least).reshape(self._shape)
        _, labels, stats, _ = cv2.connectedComponentsWithStats(changed.astype(np.uint8), connectivity=8)
        changed &= stats[labels, cv2.CC_STAT_AREA] >= LEAST_PLACES
        if not changed.any():
            return None
        first = np.where(changed.ravel(), np.argmax(differs, axis=0), len(maps)).min()
        return FilmChange(numbers[first], float(changed.sum() / (maps > UNKNOWN).any(axis=0).sum()), changed)
