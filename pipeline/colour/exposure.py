"""Matches the exposures of several frames: without it, seams show where their colours meet.

A gain of each frame and channel, in code values, makes the frames agree where they show the same surface (as in
Brown & Lowe 2007): the median of the ratios, so that highlights, which move with the lens, do not count.
"""

from collections.abc import Sequence
from dataclasses import replace
from itertools import combinations

import numpy as np

from .source_view import SourceView

STEP_PX = 4
"""Between the pixels that are compared."""
DARK, BRIGHT = 0.05, 0.95
"""Code values beyond which a pixel says nothing of the exposure."""
LEAST_PIXELS = 100
"""Two frames are compared where they share so many."""
PRIOR = 1e-3
"""Weight of a gain of 1 relative to the pixels: decides only for frames that share no surface with others."""


def matched_exposures(views: Sequence[SourceView]) -> tuple[SourceView, ...]:
    """The same views in the exposure and white balance of the first one."""
    if len(views) == 1:
        return tuple(views)
    points = [view.shown_points(STEP_PX) for view in views]
    size = len(views)
    normal, right = PRIOR * np.eye(size), np.zeros((size, 3))
    for a, b in combinations(range(size), 2):
        ratios = np.concatenate([_log_ratios(views[a], views[b], points[each]) for each in (a, b)])
        if len(ratios) < LEAST_PIXELS:
            continue
        # log gain b - log gain a is the ratio of a's colour to b's
        signs = np.zeros(size)
        signs[a], signs[b] = -1.0, 1.0
        normal += np.outer(signs, signs)
        right += signs[:, None] * np.median(ratios, axis=0)
    gains = np.exp(np.linalg.solve(normal[1:, 1:], right[1:]))
    return views[0], *(
        replace(view, image=np.clip(view.image * gain, 0, 1).astype(np.float32))
        for view, gain in zip(views[1:], gains, strict=True)
    )


def _log_ratios(a: SourceView, b: SourceView, points_model: np.ndarray) -> np.ndarray:
    """``(N, 3)`` log of a's colours over b's, of the points that both show well exposed."""
    points = points_model[a.unoccluded(points_model) & b.unoccluded(points_model)]
    colours = np.stack([view.colours(view.project(points)[0]) for view in (a, b)])
    known = ((colours > DARK) & (colours < BRIGHT)).all(axis=(0, 2))
    return np.log(colours[0, known] / colours[1, known])
