"""Matches the exposures of several frames: without it, seams show where their colours meet.

A gain of each frame and channel, in code values, makes the frames agree where they show the same surface (as in
Brown & Lowe 2007). It changes linearly across the image, as light that moves with the lens does, and least absolute
differences determine it, so that highlights, which move too, do not count.
"""

from collections.abc import Sequence
from dataclasses import replace
from itertools import combinations
from typing import Any, ClassVar, NamedTuple, Protocol, TypeVar

import numpy as np

from ..camera.pinhole import PinholeCamera

STEP_PX = 4
"""Between the pixels that are compared."""
DARK, BRIGHT = 0.05, 0.95
"""Code values beyond which a pixel says nothing of the exposure."""
LEAST_PIXELS = 100
"""Two frames are compared where they share so many."""
PRIOR = (1e-3, 1e-2, 1e-2)
"""Weights of a gain of 1 that is the same everywhere, relative to the pixels: for frames that share little."""
ROUNDS, LEAST_DIFFERENCE = 12, 0.02
"""Rounds of reweighting; logarithms of gains that differ by less count as in least squares."""


class View(Protocol):
    """A frame at its pose, as :class:`oneframe.colour.seen_frame.SeenFrame` is."""

    __dataclass_fields__: ClassVar[dict[str, Any]]

    @property
    def image(self) -> np.ndarray: ...
    @property
    def camera(self) -> PinholeCamera: ...
    def shown_points(self, step: int, /) -> np.ndarray: ...
    def unoccluded(self, points_model: np.ndarray, /) -> np.ndarray: ...
    def project(self, points_model: np.ndarray, /) -> tuple[np.ndarray, np.ndarray]: ...
    def colours(self, pixels: np.ndarray, /) -> np.ndarray: ...


AnyView = TypeVar("AnyView", bound=View)


class _Shared(NamedTuple):
    """What two frames show well exposed: log of one's colours over the other's, ``(N, 3)``.

    It is ``terms`` ``(N, 6)`` times the coefficients of both gains, which stand at the places ``at`` ``(6,)``.
    """

    at: np.ndarray
    terms: np.ndarray
    log_ratios: np.ndarray


def matched_exposures(views: Sequence[AnyView]) -> tuple[AnyView, ...]:
    """The same views in the exposure and white balance of the first one."""
    if len(views) == 1:
        return tuple(views)
    points = [view.shown_points(STEP_PX) for view in views]
    pairs = [
        _shared(views, a, b, np.concatenate([points[a], points[b]])) for a, b in combinations(range(len(views)), 2)
    ]
    pairs = [pair for pair in pairs if len(pair.log_ratios) >= LEAST_PIXELS]
    first, log_gains = len(PRIOR), np.zeros((len(views) * len(PRIOR), 3))
    for _ in range(ROUNDS):
        normal, right = np.diag(np.tile(PRIOR, len(views))), np.zeros_like(log_gains)
        for at, terms, log_ratios in pairs:
            left = terms @ log_gains[at] - log_ratios
            weights = 1 / np.maximum(np.linalg.norm(left, axis=1), LEAST_DIFFERENCE)
            weighted = terms * (weights / weights.sum())[:, None]
            # not by BLAS, whose sums depend on the number of threads: views of any machine are the same
            normal[np.ix_(at, at)] += np.einsum("ni,nj->ij", weighted, terms)
            right[at] += np.einsum("ni,nj->ij", weighted, log_ratios)
        log_gains[first:] = np.linalg.solve(normal[first:, first:], right[first:])
    gains = log_gains.reshape(len(views), first, 3)
    return views[0], *(_brighter(view, each) for view, each in zip(views[1:], gains[1:], strict=True))


def _brighter(view: AnyView, log_gain: np.ndarray) -> AnyView:
    gain = np.exp(_terms(view.camera.pixel_grid(), view.camera) @ log_gain)
    # codes stay within 0..1; albedos, of frames without the light of their lens, are beyond
    least, most = min(0.0, float(view.image.min())), max(1.0, float(view.image.max()))
    return replace(view, image=np.clip(view.image * gain, least, most).astype(np.float32))


def _terms(pixels: np.ndarray, camera: PinholeCamera) -> np.ndarray:
    """``(..., 2)`` pixels -> ``(..., 3)``: 1, and how far they are from the image's middle, in halves of its width."""
    across = (pixels - (np.array(camera.size_wh) - 1) / 2) / (camera.width / 2)
    return np.concatenate([np.ones_like(across[..., :1]), across], axis=-1)


def _shared(views: Sequence[View], a: int, b: int, points_model: np.ndarray) -> _Shared:
    points = points_model[views[a].unoccluded(points_model) & views[b].unoccluded(points_model)]
    pixels_a, pixels_b = (views[each].project(points)[0] for each in (a, b))
    colours_a, colours_b = views[a].colours(pixels_a), views[b].colours(pixels_b)
    known = np.all([(each > DARK) & (each < BRIGHT) for each in (colours_a, colours_b)], axis=(0, 2))
    terms = np.hstack([-_terms(pixels_a[known], views[a].camera), _terms(pixels_b[known], views[b].camera)])
    at = np.add.outer(len(PRIOR) * np.array([a, b]), np.arange(len(PRIOR))).ravel()
    return _Shared(at, terms, np.log(colours_a[known] / colours_b[known]))
