"""Whether frames are zoomed: a longer lens looks like a nearer camera, but for the relief of the surface.

That moves by other amounts in the image.
"""

import math
from collections.abc import Sequence
from statistics import NormalDist
from typing import NamedTuple

import numpy as np

from ..alignment.reprojection import apply_twist, zoom_jacobian_at
from ..transforms import transform_points
from .flow_refinement import FITTED, FlowFit
from .verdict import WITHIN_SHARE, robust_step, shared_covariance

STEPS, LARGEST_STEP, SETTLED_STEP = 8, 0.1, 0.001
"""Steps of the fit at most, how far one goes, and how small the last one is, as the logarithm of the focal length."""
SOFTNESS, SOFTNESS_PX = 0.04, 1.45
"""Standard deviation of what a surface, a K and a pose that are not exact add to the logarithm of a zoom, before other
frames tell: it counts as much as one frame. It is less where blocks that are off by so many px cannot shift the zoom as
far. Zooms of 169 pairs of photographs of "bloster" are as far off, those of the sample as by 0.3 px."""
STEPS_APART, HALF_APART = 2.0, 2.5
"""How much farther that reaches than from one frame to the next, and than among the half of them that lie closest."""
HALF_WIDTH = 1.349
"""Width of the middle half of a normal distribution, in standard deviations."""
SHARE, SHARE_FRAMES, WIDTH = 0.01, 10, 0.15
"""Share of frames that are zoomed, before a set tells, and how many frames that counts as much as; standard deviation
of the logarithm of their zoom."""
STATED_FRAMES = 3
"""As how many frames it counts that standard deviations are as stated."""
ROUNDS = 20
"""Rounds of finding the share."""


class Zoom(NamedTuple):
    """The focal length of a frame relative to the aligned one's, and the standard deviation of its logarithm.

    ``per_px`` is how far it would be off if each block were moved by 1 px: much where a surface is small, flat and seen
    straight on. ``moves`` ``(6,)`` is how far the pose goes with it: mm and radians by its logarithm.
    """

    factor: float
    sigma: float
    per_px: float
    moves: np.ndarray = np.zeros(6)


def zoom_of(fit: FlowFit, pivot_model: np.ndarray) -> Zoom:
    """The zoom that fits together with a pose; ``fit`` is at the aligned frame's, ``pivot_model`` ``(3,)`` mm."""
    camera, pose, zoom = fit.camera, fit.cam_from_model, 0.0
    used = fit.returning(FITTED)
    points, moved, pixels = (each[used] for each in (fit.points_model, fit.moved, fit.pixels))
    shared = shared_covariance(zoom_jacobian_at(points, camera, pose, pivot_model), pixels)
    for _ in range(STEPS):
        zoomed = camera.zoomed(np.exp(zoom))
        residuals_px = moved - zoomed.project(transform_points(pose, points))
        step, covariance = robust_step(zoom_jacobian_at(points, zoomed, pose, pivot_model), residuals_px, pixels)
        step *= min(1.0, LARGEST_STEP / max(abs(step[6]), 1e-9))
        pose, zoom, sigma = apply_twist(step[:6], pose, pivot_model), zoom + step[6], float(np.sqrt(covariance[6, 6]))
        if abs(step[6]) < SETTLED_STEP:
            break
    return Zoom(float(np.exp(zoom)), sigma, float(np.sqrt(shared[6, 6])), shared[:6, 6] / shared[6, 6])


def at_same_focal_length(zooms: Sequence[Zoom]) -> tuple[np.ndarray, np.ndarray]:
    """Probability of each frame of a set, in their order, to be within 2 % of the aligned one's focal length, ``(N,)``.

    And ``(N,)`` how far it may be from it, as the standard deviation of the logarithm: by its own estimate.
    A mixture: most frames are at that focal length, but what is not exact in the case shifts their estimates; how far
    shows in their scatter. The others are zoomed; how many they are shows too (expectation maximisation).
    """
    logs, sigmas = np.log([zoom.factor for zoom in zooms]), np.array([zoom.sigma for zoom in zooms])
    same = np.hypot(sigmas, _softness(logs, np.array([zoom.per_px for zoom in zooms])))
    zoomed = np.hypot(same, WIDTH)
    likely, likely_zoomed = (np.exp(-0.5 * (logs / each) ** 2) / each for each in (same, zoomed))
    share, is_zoomed = SHARE, np.zeros(len(logs))
    for _ in range(ROUNDS):
        is_zoomed = share * likely_zoomed / (share * likely_zoomed + (1 - share) * likely)
        share = (SHARE_FRAMES * SHARE + is_zoomed.sum()) / (SHARE_FRAMES + len(logs))
    # a zoom that is found is not the zoom that is
    mean, deviation = logs * (WIDTH / zoomed) ** 2, same * WIDTH / zoomed
    below, above = (
        np.array([NormalDist().cdf(value) for value in (limit - mean) / deviation])
        for limit in (-WITHIN_SHARE, WITHIN_SHARE)
    )
    return 1 - is_zoomed * (1 - above + below), np.hypot(logs, same)


def understated(zooms: Sequence[Zoom], same: np.ndarray) -> float:
    """By how much the standard deviations of a set are too small, at least 1: the zoom's, whose truth is known.

    ``same`` ``(N,)`` is what :func:`at_same_focal_length` gives first.
    """
    squares = np.array([(math.log(zoom.factor) / zoom.sigma) ** 2 for zoom in zooms])
    return max(1.0, math.sqrt((STATED_FRAMES + same @ squares) / (STATED_FRAMES + same.sum())))


def _softness(logs: np.ndarray, per_px: np.ndarray) -> np.ndarray:
    """How far what is not exact shifts zooms: by the steps between them, or by those that lie closest."""
    count, expected = len(logs), np.minimum(SOFTNESS, SOFTNESS_PX * per_px)
    if count < 3:
        return expected
    ordered, half = np.sort(logs), (count + 1) // 2
    closest = HALF_APART / HALF_WIDTH * float((ordered[half - 1 :] - ordered[: count - half + 1]).min())
    # a slow zoom goes far in small steps
    steps = STEPS_APART * math.sqrt((np.diff(logs) ** 2).mean() / 2)
    return np.sqrt((expected**2 + count * min(closest, steps) ** 2) / (1 + count))
