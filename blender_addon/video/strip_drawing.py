"""Draws the strip: thumbnails and scores over one time axis, the best frames, the frame in view and its figures.

Without K it also draws the film's frame, or the case's, large in the view.
"""

from functools import lru_cache
from pathlib import Path

import bpy
import cv2
import gpu
import numpy as np
from gpu_extras.batch import batch_for_shader

from ..class_registration import at_end, drawing, listening
from ..state import another_frame, from_scene, workbench
from ..state.scene_files import Stamp, known_stamp
from ..ui.strokes import Colour, Strokes
from ..view.zoom import free_rectangle, reserved
from . import strip_gizmo, strip_pictures
from .session import FilmSession
from .strip_layout import StripLayout, film_in, reserved_height

BACKGROUND: Colour = (0.05, 0.05, 0.05, 0.85)
INK: Colour = (0.92, 0.92, 0.92, 1.0)
FAINT: Colour = (0.6, 0.6, 0.6, 1.0)
CURVE: Colour = (0.35, 0.75, 1.0, 1.0)
AREA: Colour = (0.35, 0.75, 1.0, 0.3)
BEST: Colour = (1.0, 0.75, 0.2, 1.0)
SHOWN: Colour = (1.0, 1.0, 1.0, 1.0)
HOVERED: Colour = (1.0, 1.0, 1.0, 0.45)

TICK_STEPS_S = (0.04, 0.1, 0.2, 0.5, 1, 2, 5, 10, 30, 60, 120, 300, 600, 1800, 3600, 7200)
TICK_PX = 90
"""Least distance of two times that are written below the curve, at interface scale 1."""


def draw_strip() -> None:
    """Draw the strip of the 3D view that Blender is drawing now (a POST_PIXEL draw handler)."""
    context = bpy.context
    scene, film, layout = context.scene, film_in(context), StripLayout.of(context)
    if from_scene.present_camera(scene) is None:
        if film is not None:
            key = str(film.path), film.shown, film.picture.shape
            _draw_alone(context, key, film.picture, film.scores.info.size_wh)
        elif workbench.is_workbench(scene) and scene.oneframe.frame_path:
            path = from_scene.absolute_path(scene.oneframe.frame_path)
            stamp = known_stamp(path)
            picture = _frame(path, stamp)
            if picture is not None:
                _draw_alone(context, (str(path), stamp), picture, (picture.shape[1], picture.shape[0]))
    if film is None or layout is None:
        return
    pointer = strip_gizmo.pointer_in(context.region)
    (left, below), (right, above) = layout.low, layout.high
    corners = [(left, below), (right, below), (right, above), (left, below), (right, above), (left, above)]
    draw_triangles(np.array(corners), BACKGROUND)
    _draw_thumbnails(film, layout)
    strokes = Strokes()
    _draw_curve(film, layout, strokes)
    _draw_ticks(layout, strokes)
    _draw_best(film, layout, strokes)
    hovered = None if pointer is None else film.at_time(layout.time_at(pointer[0]))
    if hovered is not None:
        _line_at(film, layout, strokes, hovered, HOVERED, 1.0)
    _line_at(film, layout, strokes, film.shown, SHOWN, 2.0)
    _draw_texts(context.scene, film, layout, strokes, over=hovered is not None)
    strokes.draw()


def figures(film: FilmSession, at: int) -> list[str]:
    """A frame's number, time and scores, the most important first."""
    score = film.scores.frames[at]
    rank = film.rank(at)
    return [
        f"Frame {score.index}",
        clock(score.time_s, 0.01),
        f"score {score.total:.2f}" + (f" (best {rank})" if rank else ""),
        f"sharp {score.sharpness:.2f}",
        f"glare {score.glare:.1%}",
        f"covered {score.obstructed:.1%}",
    ]


def clock(time_s: float, step_s: float) -> str:
    """``1:02`` or, in steps of parts of a second, ``1:02.40``."""
    decimals = 0 if step_s >= 1 else 1 if step_s >= 0.1 else 2
    hundredths = round(time_s * 10**decimals) / 10**decimals
    minutes, seconds = divmod(hundredths, 60)
    width = 2 if decimals == 0 else 3 + decimals
    if minutes >= 60:
        return f"{int(minutes // 60)}:{int(minutes % 60):02d}:{seconds:0{width}.{decimals}f}"
    return f"{int(minutes)}:{seconds:0{width}.{decimals}f}"


def _draw_alone(context: bpy.types.Context, key: object, picture: np.ndarray, size_wh: tuple[int, int]) -> None:
    """The frame in the free part of the view: without K no camera shows it."""
    low, high = free_rectangle(context.area)
    size = np.array(size_wh) * float(np.min((high - low) / size_wh))
    first = (low + high - size) / 2
    strip_pictures.draw_picture(("alone", key), picture, tuple(first), tuple(first + size))


@lru_cache(maxsize=1)
def _frame(path: Path, stamp: Stamp) -> np.ndarray | None:
    """``(H, W, 3)`` uint8 RGB of the case's frame; ``None`` if it is gone, or OpenCV cannot read it."""
    image = cv2.imread(str(path), cv2.IMREAD_COLOR | cv2.IMREAD_IGNORE_ORIENTATION) if any(stamp) else None
    return None if image is None else cv2.cvtColor(image, cv2.COLOR_BGR2RGB)


def _draw_thumbnails(film: FilmSession, layout: StripLayout) -> None:
    low, high = layout.thumbnails
    if high <= low:
        return
    width, height = film.scores.info.size_wh
    across = max((high - low) * width / height, 8.0)
    left, right = layout.low[0], layout.high[0]
    count = max(1, int((right - left) // across))
    # spread over the whole width: each stands in the middle of its time
    step = (right - left) / count
    for number in range(count):
        middle = left + (number + 0.5) * step
        at = film.at_time(layout.time_at(middle))
        index, picture = film.thumbnails.nearest(film.scores.frames[at].index)
        half = min(across, right - left) / 2
        strip_pictures.draw_picture((str(film.path), index), picture, (middle - half, low), (middle + half, high))


def _draw_curve(film: FilmSession, layout: StripLayout, strokes: Strokes) -> None:
    begin, end = layout.span_s
    first = max(int(np.searchsorted(film.times_s, begin)) - 1, 0)
    last = min(int(np.searchsorted(film.times_s, end)) + 1, len(film.times_s))
    x, totals = layout.x_of(film.times_s[first:last]), film.totals[first:last]
    x, totals = _highest(x, totals, layout.unit)
    low, high = layout.curve
    inside = np.clip(x, layout.low[0], layout.high[0])
    y = low + np.interp(inside, x, totals) * (high - low)
    line = np.stack([inside, y], axis=1)
    if len(line) > 1:
        base = np.stack([inside, np.full(len(inside), low)], axis=1)
        quads = np.stack([base[:-1], base[1:], line[1:], base[:-1], line[1:], line[:-1]], axis=1).reshape(-1, 2)
        draw_triangles(quads, AREA)
    strokes.line(line, CURVE, width=1.0)
    strokes.line(np.array([[layout.low[0], low], [layout.high[0], low]]), FAINT, width=0.5)


def _highest(x: np.ndarray, totals: np.ndarray, unit: float) -> tuple[np.ndarray, np.ndarray]:
    """At most one point a pixel: the best frame there, so that no good one is lost in a long film."""
    if len(x) < 2:
        return x, totals
    columns = np.floor(x / max(unit, 1.0)).astype(np.int64)
    starts = np.flatnonzero(np.diff(columns, prepend=columns[0] - 1))
    if len(starts) == len(x):
        return x, totals
    return x[starts], np.maximum.reduceat(totals, starts)


def _draw_ticks(layout: StripLayout, strokes: Strokes) -> None:
    begin, end = layout.span_s
    least = TICK_PX * layout.unit / (layout.high[0] - layout.low[0]) * (end - begin)
    step = next((step for step in TICK_STEPS_S if step >= least), TICK_STEPS_S[-1])
    for number in range(int(np.ceil(max(begin, 0.0) / step)), int(np.floor(end / step)) + 1):
        x, text = float(layout.x_of(number * step)), clock(number * step, step)
        strokes.line(np.array([[x, layout.curve[0]], [x, layout.curve[0] - 4 * layout.unit]]), FAINT, width=1.0)
        if x + strokes.width_of(text) + 4 * layout.unit < layout.high[0]:
            strokes.text(np.array([x + 3 * layout.unit, layout.low[1] + 5 * layout.unit]), text, FAINT)


def _draw_best(film: FilmSession, layout: StripLayout, strokes: Strokes) -> None:
    begin, end = layout.span_s
    for rank, at in enumerate(film.best, start=1):
        if not begin <= film.times_s[at] <= end:
            continue
        x = float(layout.x_of(film.times_s[at]))
        strokes.line(np.array([[x, layout.curve[0]], [x, layout.curve[1]]]), BEST, width=1.5)
        # beside the line, on the side where there is room
        shift = 3 * layout.unit
        if x + shift + strokes.width_of(str(rank)) > layout.high[0]:
            shift = -shift - strokes.width_of(str(rank))
        strokes.text(np.array([x + shift, layout.curve[1] - 12 * layout.unit]), str(rank), BEST)


def _line_at(film: FilmSession, layout: StripLayout, strokes: Strokes, at: int, colour: Colour, width: float) -> None:
    x = float(layout.x_of(film.times_s[at]))
    if layout.low[0] <= x <= layout.high[0]:
        strokes.line(np.array([[x, layout.curve[0]], [x, layout.thumbnails[1]]]), colour, width=width)


def _draw_texts(
    scene: bpy.types.Scene, film: FilmSession, layout: StripLayout, strokes: Strokes, *, over: bool
) -> None:
    """Figures of the frame in view, also while the pointer is over the strip, and what the view shows."""
    unit = layout.unit
    y = layout.thumbnails[1] + 5 * unit
    state = _state(scene, film, over=over)
    room = layout.high[0] - layout.low[0] - 12 * unit - strokes.width_of(state)
    if room < strokes.width_of(figures(film, film.shown)[0]):
        state, room = "", layout.high[0] - layout.low[0] - 6 * unit
    parts = figures(film, film.shown)
    while len(parts) > 1 and strokes.width_of("   ".join(parts)) > room - 12 * unit:
        parts.pop()
    strokes.text(np.array([layout.low[0] + 5 * unit, y]), "   ".join(parts), INK)
    if state:
        strokes.text(np.array([layout.high[0] - 5 * unit - strokes.width_of(state), y]), state, FAINT)


def _state(scene: bpy.types.Scene, film: FilmSession, *, over: bool) -> str:
    failure = film.fetcher.failure(film.shown)
    if failure:
        return "cannot be decoded"
    if (other := another_frame.seen(scene)) is not None:
        return f"{other.text}   Enter: Take" if over else other.text
    if from_scene.present_camera(scene) is not None and scene.oneframe.frame_path:
        return "the case's frame is in view"
    if not film.is_full:
        return "decoding ..."
    return "Enter: Take" if over else "not taken"


def draw_triangles(points: np.ndarray, colour: Colour) -> None:
    """Fill triangles, three points ``(2,)`` each, px of the region."""
    shader = gpu.shader.from_builtin("UNIFORM_COLOR")
    batch = batch_for_shader(shader, "TRIS", {"pos": np.float32(points)})
    shader.bind()
    shader.uniform_float("color", colour)
    gpu.state.blend_set("ALPHA")
    batch.draw(shader)
    gpu.state.blend_set("NONE")


PARTS = (
    at_end(strip_pictures.clear, _frame.cache_clear),
    drawing(bpy.types.SpaceView3D, draw_strip, "POST_PIXEL"),
    listening(reserved, reserved_height),
)
