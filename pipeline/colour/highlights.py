"""Highlights leave the colour: they move with the lens, so of three frames that saw a point, most show it without.

Where three frames or more saw a point, the one in which it is clearly brighter than in their median does not colour it;
another one does. What a frame is brighter by at random (noise) does not count, and neither does what the median shows
close by: there a pattern is out of place, as poses and surface are slightly off.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from .source_view import SourceView

STEP_PX = 2
"""Between the pixels that are compared: highlights are larger."""
FEWEST_FRAMES = 3
OUT_OF_PLACE = 0.01
"""Of the frame's width: so far from its place a pattern may be."""
LEAST_EXCESS = 0.06
"""Code values by which a highlight is brighter than the median, at least, and"""
LEAST_DEVIATIONS = 3.0
"""standard deviations of the differences, by their median."""
MAD_TO_SIGMA = 1.4826


def without_highlights(views: Sequence[SourceView]) -> tuple[SourceView, ...]:
    """The same views, in one exposure, masked where they show a highlight that others do not."""
    if len(views) < FEWEST_FRAMES:
        return tuple(views)
    return tuple(_masked(view, views) for view in views)


def _masked(view: SourceView, views: Sequence[SourceView]) -> SourceView:
    shown, points = view.depth_mm[::STEP_PX, ::STEP_PX] > 0, view.shown_points(STEP_PX)
    brightness = np.full((len(views), len(points)), np.nan, np.float32)
    for number, other in enumerate(views):
        seen = other.unoccluded(points)
        brightness[number, seen] = other.colours(other.project(points[seen])[0]).mean(axis=1)
    count = np.isfinite(brightness).sum(axis=0)
    # the lower of two in the middle; what is not known is sorted to the end
    median = np.take_along_axis(np.sort(brightness, axis=0), (np.maximum(count, 1) - 1)[None] // 2, axis=0)[0]
    own = view.image[::STEP_PX, ::STEP_PX][shown].mean(axis=1)
    compared = count >= FEWEST_FRAMES
    if not compared.any():
        return view
    deviation = MAD_TO_SIGMA * float(np.median(np.abs(own - median)[compared]))
    usual, bright, known = np.zeros((3, *shown.shape), np.float32)
    usual[shown], known[shown] = np.where(compared, median, 0), compared
    usual = _largest_around(usual, round(OUT_OF_PLACE * view.camera.width / STEP_PX))
    bright[shown] = compared & (own - usual[shown] > max(LEAST_EXCESS, LEAST_DEVIATIONS * deviation))
    # not single pixels, but with the skirts; where others saw all around it
    core = 1 - _largest_around(1 - bright, 1)
    highlight = (_largest_around(core, 2) > 0) & (_largest_around(1 - known, 1) == 0)
    height, width = view.valid.shape
    masked = np.repeat(np.repeat(highlight, STEP_PX, axis=0), STEP_PX, axis=1)[:height, :width]
    inverse_depth = np.where(masked, np.float32(0), view.inverse_depth)
    return replace(view, valid=view.valid & ~masked, inverse_depth=inverse_depth)


def _largest_around(values: np.ndarray, radius: int) -> np.ndarray:
    """``(H, W)`` values, not negative -> the largest in a square around each."""
    for axis in range(2):
        around = np.pad(values, [(radius * (each == axis),) * 2 for each in range(2)])
        values = sliding_window_view(around, 2 * radius + 1, axis=axis).max(axis=-1)
    return values
