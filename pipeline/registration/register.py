"""Register frames: the pose of each, from the pose before it or from nothing, and whether to trust it.

A frame may be zoomed: a longer lens looks like a nearer camera, but for the relief of the surface, which moves by other
amounts in the image.
"""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from statistics import NormalDist
from typing import NamedTuple

import numpy as np

from ..alignment.pose_uncertainty import PoseUncertainty
from ..alignment.reprojection import apply_twist, zoom_jacobian_at
from ..camera.pinhole import PinholeCamera
from ..colour.source_view import SourceView
from ..errors import InputError
from ..surface.mesh import TriangleMesh
from ..transforms import transform_points
from .flow_refinement import FITTED, FlowFit, refined_by_flow
from .known_views import KnownViews, Localised, ViewBank, bank_of, localised
from .verdict import (
    ACCEPTED,
    DOUBTFUL,
    LEAST_ACCEPTED,
    LEAST_DOUBTFUL,
    REFUSED,
    WITHIN_SHARE,
    Verdict,
    block_pixels,
    judge,
    robust_step,
    shared_covariance,
)

LEAST_FEATURES = 200

STEPS, LARGEST_STEP, SETTLED_STEP = 8, 0.1, 0.001
"""Steps of the fit at most, how far one goes, and how small the last one is, as the logarithm of the focal length."""
SURE = 0.995
"""Probability of a guess above which features are not asked: they find another pose in a few of those below."""
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
    straight on.
    """

    factor: float
    sigma: float
    per_px: float


def zoom_of(fit: FlowFit, pivot_model: np.ndarray) -> Zoom:
    """The zoom that fits together with a pose; ``fit`` is at the aligned frame's, ``pivot_model`` ``(3,)`` mm."""
    camera, pose, zoom = fit.camera, fit.cam_from_model, 0.0
    used = fit.returning(FITTED)
    points, moved, pixels = (each[used] for each in (fit.points_model, fit.moved, block_pixels(fit)))
    sigma = np.inf
    per_px = np.sqrt(shared_covariance(zoom_jacobian_at(points, camera, pose, pivot_model), pixels)[6, 6])
    for _ in range(STEPS):
        zoomed = camera.zoomed(np.exp(zoom))
        residuals_px = moved - zoomed.project(transform_points(pose, points))
        step, covariance = robust_step(zoom_jacobian_at(points, zoomed, pose, pivot_model), residuals_px, pixels)
        step *= min(1.0, LARGEST_STEP / max(abs(step[6]), 1e-9))
        pose, zoom, sigma = apply_twist(step[:6], pose, pivot_model), zoom + step[6], float(np.sqrt(covariance[6, 6]))
        if abs(step[6]) < SETTLED_STEP:
            break
    return Zoom(float(np.exp(zoom)), sigma, float(per_px))


def at_same_focal_length(zooms: Sequence[Zoom]) -> np.ndarray:
    """Probability of each frame of a set, in their order, to be within 2 % of the aligned one's focal length, ``(N,)``.

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
    return 1 - is_zoomed * (1 - above + below)


def understated(zooms: Sequence[Zoom], same: np.ndarray) -> float:
    """By how much the standard deviations of a set are too small, at least 1: the zoom's, whose truth is known.

    ``same`` ``(N,)`` is :func:`at_same_focal_length`.
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


@dataclass(frozen=True)
class RegisteredFrame:
    """A frame with its pose, unless it is refused.

    Attributes
    ----------
    verdict
        State, probability and reason.
    cam_from_model
        ``(4, 4)`` the pose, mm.
    uncertainty
        That of the pose, as far as the frame tells: for the error of the aligned frame's see :func:`.with_case`.
    fit
        What the pose was found from.
    zoom
        The focal length that fits best; judged by :func:`judged_together`.
    changed
        Whether the film no longer shows there what the case's frame shows.
    """

    verdict: Verdict
    cam_from_model: np.ndarray | None = None
    uncertainty: PoseUncertainty | None = None
    fit: FlowFit | None = None
    zoom: Zoom | None = None
    changed: bool = False


def judged_together(frames: Sequence[RegisteredFrame]) -> list[RegisteredFrame]:
    """Frames of one set, in their order, less sure or refused where they seem to be zoomed.

    Where their zooms scatter by more than they state, as on a soft surface, the covariances of all poses grow as much.
    """
    judged = list(frames)
    zooms = {number: frame.zoom for number, frame in enumerate(frames) if frame.zoom is not None}
    if not zooms:
        return judged
    same_of_all = at_same_focal_length(list(zooms.values()))
    factor = understated(list(zooms.values()), same_of_all)
    for number, same in zip(zooms, same_of_all, strict=True):
        found = frames[number]
        if found.uncertainty is not None:
            found = replace(found, uncertainty=found.uncertainty.widened(factor))
        probability = found.verdict.probability * float(same)
        reason = (
            f"the zoom seems to be {zooms[number].factor:.2f} times that of the case's frame, or that frame's pose is "
            f"off (--correct-source)"
        )
        if max(probability, float(same)) < LEAST_DOUBTFUL:
            judged[number] = RegisteredFrame(Verdict(REFUSED, probability, reason))
            continue
        verdict = replace(found.verdict, probability=probability)
        if verdict.state == ACCEPTED and probability < LEAST_ACCEPTED:
            verdict = Verdict(DOUBTFUL, probability, reason)
        judged[number] = replace(found, verdict=verdict)
    return judged


class Registrar:
    """Registers frames of one camera to a surface, by what an aligned frame shows of it."""

    def __init__(self, mesh: TriangleMesh, source: SourceView, pivot_model: np.ndarray) -> None:
        """Prepare a surface (model frame), the aligned frame and the ``(3,)`` middle of what it shows, mm."""
        self._views, self._pivot_model = KnownViews(mesh, source), pivot_model

    @property
    def camera(self) -> PinholeCamera:
        """The camera of the frames."""
        return self._views.source.camera

    @cached_property
    def _bank(self) -> ViewBank:
        bank = bank_of(self._views, self._pivot_model)
        if len(bank) < LEAST_FEATURES:
            raise InputError(
                f"the case's frame: expected texture on the surface, found {len(bank)} features (at least "
                f"{LEAST_FEATURES}); choose a sharper frame"
            )
        return bank

    def register(
        self,
        grey: np.ndarray,
        valid: np.ndarray,
        near: np.ndarray | None = None,
        guesses: Iterable[np.ndarray] = (),
    ) -> RegisteredFrame:
        """Register a frame.

        Parameters
        ----------
        grey, valid
            ``(H, W)`` uint8 undistorted image, and ``(H, W)`` bool: pixels that may be used.
        near
            ``(4, 4)`` a pose that may be near, such as the frame's before.
        guesses
            Further ones, tried before the features, which take longer and follow where none of these is sure.

        Raises
        ------
        InputError
            The aligned frame shows too little texture on the surface.
        """
        if near is not None:
            registered = self._refined(grey, valid, near)
            if registered.verdict.state == ACCEPTED:
                return registered
        others = list[RegisteredFrame]()
        for guess in guesses:
            others.append(self._refined(grey, valid, guess))
            if others[-1].verdict.probability > SURE:
                return others[-1]
        found = localised(self._bank, self.camera, grey, valid)
        own = self._judged(None, None) if found is None else self._refined(grey, valid, found.cam_from_model, found)
        return max([own, *others], key=lambda each: each.verdict.probability)

    def _refined(
        self, grey: np.ndarray, valid: np.ndarray, cam_from_model: np.ndarray, found: Localised | None = None
    ) -> RegisteredFrame:
        """A frame refined from a rough pose, by what is known as it is, and if it is not accepted, blurred as it."""
        judged = list[RegisteredFrame]()
        for blurred in (False, True):
            fit = refined_by_flow(self._views, grey, valid, cam_from_model, blurred=blurred)
            judged.append(self._judged(fit, found))
            if judged[-1].verdict.state == ACCEPTED:
                return judged[-1]
        return max(judged, key=lambda each: each.verdict.probability)

    def _judged(self, fit: FlowFit | None, found: Localised | None) -> RegisteredFrame:
        verdict, uncertainty = judge(fit, found, self._pivot_model)
        if fit is None or verdict.state == REFUSED:
            return RegisteredFrame(verdict)
        return RegisteredFrame(verdict, fit.cam_from_model, uncertainty, fit)
