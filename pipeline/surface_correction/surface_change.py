"""When a surface changes between frames, as bone that is drilled does: no displacement explains all of them.

Where it has changed, what is left between the case's frame and others is small up to one of them, and larger in each
later one. It is compared with the rest of the same frame, so blur does not look like it.
"""

import numpy as np

from .control_points import ControlPoints
from .displacement_fit import Observed

LEAST_FRAMES = 3
"""That tell of a place before it changes, and after."""
LEAST_TOLD = 0.3
"""Pixels of a frame that tell of a place, by their weights."""
MOST_PX, APART_PX = 2.0, 0.2
"""What is left beyond which more says nothing, and between the largest before and the smallest after."""
BLURRED = 2.0
"""What is left in the middle of a frame, relative to that of all, from which it does not count."""
LEAST_PLACES, AMONG = 8, 0.5
"""Of them, each with more than this part of its neighbours: up to 4 where a wrong surface looks otherwise from the side
that later frames are on, 21 to 57 where a floor is drilled 1 mm deeper."""


def changed_since(points: ControlPoints, known: Observed, left_px: np.ndarray, count: int) -> int | None:
    """The first of ``count`` frames, in the order of time, that shows a changed surface; ``None`` without one.

    ``(N,)`` px is what a fit leaves at the pixels; the case's frame is the first of all.
    """
    own = known.frames[:, 0] == 0
    weights, others, left = known.weights[own], known.frames[own, 1], np.minimum(left_px[own], MOST_PX)
    shown, middle = np.full((count, weights.shape[1]), np.nan), np.full(count, np.nan)
    for number in np.unique(others):
        at = others == number
        middle[number], tell = np.median(left[at]), weights[at].T @ np.ones(at.sum())
        shown[number] = weights[at].T @ (left[at] - middle[number]) / np.where(tell > LEAST_TOLD, tell, np.nan)
    shown[middle > BLURRED * np.nanmedian(middle)] = np.nan
    changed, told = np.zeros(count), np.isfinite(shown)
    for since in range(1 + LEAST_FRAMES, count + 1 - LEAST_FRAMES):
        both = (told[:since].sum(axis=0) >= LEAST_FRAMES) & (told[since:].sum(axis=0) >= LEAST_FRAMES)
        before = np.where(told, shown, -np.inf)[:since].max(axis=0)
        after = np.where(told, shown, np.inf)[since:].min(axis=0)
        gone = both & (after > before + APART_PX)
        changed[since] = np.sum(gone & (points.bending @ gone < 1 - AMONG))
    return int(np.argmax(changed)) if np.max(changed) > LEAST_PLACES else None
