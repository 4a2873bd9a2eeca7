"""Draws a band along the strip of the film: which frames are found, doubtful and lost."""

import bpy
import numpy as np

from ..class_registration import drawing
from ..pipeline.registration.verdict import COLOURS
from ..video import session
from ..video.strip_drawing import draw_triangles
from ..video.strip_layout import StripLayout
from . import found

HEIGHT = 6
"""At interface scale 1, in the gap above the curve."""


def _draw_band() -> None:
    context = bpy.context
    layout, film, registered = StripLayout.of(context), session.of(context.scene), found.of(context.scene)
    if layout is None or film is None or registered is None:
        return
    times_s = film.times_s
    half_s = 0.5 * float(np.median(np.diff(times_s))) if len(times_s) > 1 else 0.5
    high = layout.thumbnails[0] - layout.unit
    low = high - HEIGHT * layout.unit
    frames = [registered.frames.get(score.index) for score in film.scores.frames]
    # in this order: in a long film, several of which share a pixel, lost frames are seen
    for state in found.WORDS:
        middle_s = times_s[[frame is not None and frame.verdict.state == state for frame in frames]]
        left, right = np.clip(layout.x_of(middle_s + half_s * np.array([[-1], [1]])), layout.low[0], layout.high[0])
        left, right = left[right > left], np.maximum(right, left + 1)[right > left]
        if len(left):
            corners = [(left, low), (right, low), (right, high), (left, low), (right, high), (left, high)]
            points = [np.stack([x, np.full(len(x), y)], axis=-1) for x, y in corners]
            red, green, blue = (value / 255 for value in COLOURS[state])
            draw_triangles(np.stack(points, axis=1).reshape(-1, 2), (red, green, blue, 1.0))


PARTS = (drawing(bpy.types.SpaceView3D, _draw_band, "POST_PIXEL"),)
