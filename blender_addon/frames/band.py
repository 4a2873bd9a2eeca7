"""Draws a band along the strip of the film: which frames are found, doubtful and lost, and which one is the case's."""

import json

import bpy
import numpy as np

from ..class_registration import class_registration, drawing
from ..ui.strokes import Strokes
from ..video.session import FilmSession
from ..video.strip_drawing import INK, draw_triangles
from ..video.strip_layout import StripLayout, film_in
from . import found
from .found import FoundFrames

HEIGHT = 6
"""At interface scale 1, above the curve."""


def _draw_band() -> None:
    context = bpy.context
    scene, film, layout = context.scene, film_in(context), StripLayout.of(context)
    if film is None or layout is None:
        return
    registered = found.of(scene)
    if registered is not None:
        _draw_states(registered, layout)
    own = _own_frame(scene, film)
    if own is not None and layout.span_s[0] <= film.times_s[own] <= layout.span_s[1]:
        strokes, x = Strokes(), float(layout.x_of(film.times_s[own]))
        high = layout.thumbnails[0]
        strokes.line(np.array([[x, high - HEIGHT * layout.unit], [x, high]]), INK, width=3.0)
        strokes.draw()


def _draw_states(registered: FoundFrames, layout: StripLayout) -> None:
    times_s = registered.film.times_s
    half_s = 0.5 * float(np.median(np.diff(times_s))) if len(times_s) > 1 else 0.5
    high = layout.thumbnails[0] - layout.unit
    low = high - HEIGHT * layout.unit
    frames = list(registered.frames.items())
    # in this order: in a long film, several of which share a pixel, lost frames are seen
    for state in found.WORDS:
        middle_s = times_s[[at for at, frame in frames if frame.verdict.state == state]]
        left, right = np.clip(layout.x_of(middle_s + half_s * np.array([[-1], [1]])), layout.low[0], layout.high[0])
        inside = right > left
        left, right = left[inside], np.maximum(right, left + 1)[inside]
        corners = [(left, low), (right, low), (right, high), (left, low), (right, high), (left, high)]
        points = [np.stack([x, np.full(len(x), y)], axis=-1) for x, y in corners]
        if len(left):
            draw_triangles(np.stack(points, axis=1).reshape(-1, 2), found.colour_of(state))


def _own_frame(scene: bpy.types.Scene, film: FilmSession) -> int | None:
    """Position of the case's frame in the film, as far as the case says that it is from there."""
    text = scene.oneframe.video_text
    name, number = json.loads(text) if text else ("", -1)
    if name != film.path.name:
        return None
    return next((at for at, score in enumerate(film.scores.frames) if score.index == number), None)


register, unregister = class_registration(__name__, drawing(bpy.types.SpaceView3D, _draw_band, "POST_PIXEL"))
