"""Where the strip lies in a 3D view, and which time of the film is where."""

from dataclasses import dataclass

import bpy
import numpy as np

from ..state import from_scene
from ..ui.frame_view import shows_frame, window_region
from ..view.zoom import uncovered_rectangle
from . import session
from .session import FilmSession

MARGIN, TEXT_ROW, CURVE, THUMBNAILS, GAP = 8, 20, 44, 60, 9
"""Heights at interface scale 1."""

LARGEST_SHARE = 0.4
"""Of the view's height; where there is less room, there are no thumbnails."""

LEAST_WIDTH = 120

LEAST_FRAMES = 8
"""Frames that the strip shows when it is zoomed in as far as possible."""


@dataclass(frozen=True)
class StripLayout:
    """Places of the strip, px of the view's region.

    Attributes
    ----------
    low, high
        Corners of the whole strip: lower left, upper right.
    curve, thumbnails
        Lower and upper edge of these rows; equal if there are no thumbnails.
    span_s
        Times at the left and the right end.
    unit
        One pixel at interface scale 1.
    """

    low: tuple[float, float]
    high: tuple[float, float]
    curve: tuple[float, float]
    thumbnails: tuple[float, float]
    span_s: tuple[float, float]
    unit: float

    @classmethod
    def of(cls, context: bpy.types.Context) -> "StripLayout | None":
        """The strip in the context's 3D view; ``None`` if that shows none."""
        film = film_in(context)
        return None if film is None else layout_of(context.area, film.span_s)

    def x_of(self, time_s: np.ndarray | float) -> np.ndarray:
        """Region px of times."""
        begin, end = self.span_s
        return self.low[0] + (np.asarray(time_s) - begin) / (end - begin) * (self.high[0] - self.low[0])

    def time_at(self, x: float) -> float:
        """Time at a region px, s."""
        begin, end = self.span_s
        return begin + (x - self.low[0]) / (self.high[0] - self.low[0]) * (end - begin)

    def contains(self, x: float, y: float) -> bool:
        """Whether a point of the region is in the strip."""
        return self.low[0] <= x < self.high[0] and self.low[1] <= y < self.high[1]


def film_in(context: bpy.types.Context) -> FilmSession | None:
    """The film whose strip the context's 3D view shows: through the frame's camera, or any as long as there is none."""
    space, scene = context.space_data, context.scene
    if space is None or space.type != "VIEW_3D" or not scene.oneframe_video.visible:
        return None
    if from_scene.present_camera(scene) is not None and not shows_frame(context):
        return None
    return session.of(scene)


def layout_of(area: bpy.types.Area, span_s: tuple[float, float]) -> StripLayout | None:
    """The strip at the bottom of a 3D view; ``None`` if there is no room."""
    unit = bpy.context.preferences.system.ui_scale
    low, high = uncovered_rectangle(area)
    left, right, below = low[0] + MARGIN * unit, high[0] - MARGIN * unit, low[1] + MARGIN * unit
    height = window_region(area).height
    curve = below + TEXT_ROW * unit, below + (TEXT_ROW + CURVE) * unit
    thumbnails = curve[1] + GAP * unit, curve[1] + (GAP + THUMBNAILS) * unit
    top = thumbnails[1] + TEXT_ROW * unit
    if top - below > LARGEST_SHARE * height:
        # the gap stays: the band of the found frames lies in it
        thumbnails = (thumbnails[0],) * 2
        top = thumbnails[1] + TEXT_ROW * unit
    if top - below > LARGEST_SHARE * height or right - left < LEAST_WIDTH * unit:
        return None
    return StripLayout((left, below), (right, top), curve, thumbnails, span_s, unit)


def reserved_height(area: bpy.types.Area) -> float:
    """How much of a view's height, from below, the strip takes; for the fit of the frame above it."""
    context = bpy.context
    if context.area != area or film_in(context) is None:
        return 0.0
    found = layout_of(area, (0.0, 1.0))
    return 0.0 if found is None else found.high[1]


def zoomed(film: FilmSession, span_s: tuple[float, float], factor: float, about_s: float) -> tuple[float, float]:
    """A span that shows ``factor`` times as much detail about a time, inside the film."""
    first, last = film.whole_span_s
    shortest = (last - first) * min(1.0, LEAST_FRAMES / len(film.times_s))
    length = min(max((span_s[1] - span_s[0]) / factor, shortest), last - first)
    share = (about_s - span_s[0]) / (span_s[1] - span_s[0])
    begin = min(max(about_s - share * length, first), last - length)
    return begin, begin + length


def following(film: FilmSession) -> tuple[float, float]:
    """The span, moved by as little as needed to show the frame in view."""
    begin, end = film.span_s
    first, last = film.whole_span_s
    time_s, edge = float(film.times_s[film.shown]), 0.05 * (end - begin)
    shift = min(time_s - edge - begin, 0.0) + max(time_s + edge - end, 0.0)
    shift = min(max(shift, first - begin), last - end)
    return begin + shift, end + shift
