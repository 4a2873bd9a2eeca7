"""The panel Frames: the other frames of the surface, as a queue with pictures and states, and those of the film.

A band along the Timeline of the film says which frames are found, doubtful and lost.
"""

from typing import Any

import bpy
import bpy.utils.previews
import gpu
import numpy as np
from gpu_extras.batch import batch_for_shader

from ..class_registration import at_end
from ..pipeline.case.case_queue import ALIGNED, CHECKED, DOUBTFUL, NEW, REFUSED, ROUGH
from ..pipeline.registration.verdict import COLOURS
from ..setup import queued
from ..state import frame_in_view
from ..ui.keymap import draw_key
from ..ui.pane import Pane
from ..ui.panel import AdvancedPanel, AlignmentPanel, draw_text
from ..ui.strokes import Strokes
from ..video import session
from ..video.session import FilmSession
from . import film_poses
from .operators import is_aligned

ICONS = {
    NEW: "RADIOBUT_OFF",
    ROUGH: "DOT",
    ALIGNED: "RADIOBUT_ON",
    CHECKED: "CHECKMARK",
    DOUBTFUL: "ERROR",
    REFUSED: "CANCEL",
}
"""State of a case -> its icon."""
AROUND = 3
"""Frames shown before and after the present one."""
TEXT_LINES = 3
"""Of what is said of the frame in view: no button moves under the pointer, here and above, when a text changes."""

_pictures: dict[str, Any] = {}
"""One collection of previews, once a queue is drawn."""


class ONEFRAME_PT_frames(AlignmentPanel, AdvancedPanel):
    """The other frames of this surface, one after the other: of the queue, and of the film"""

    bl_label = "Frames"
    bl_order = 3

    def draw(self, context: bpy.types.Context) -> None:
        layout, scene = self.layout, context.scene
        layout.operator_context = "INVOKE_DEFAULT"
        row = layout.row(align=True)
        row.operator("oneframe.queue_frames", icon="ADD")
        row.operator("oneframe.queue_video_frames", text="", icon="FILE_MOVIE")
        row.operator("oneframe.queue_video_frames", text="Best", icon="FILE_MOVIE").best = True
        if entries := queued.queue_of(scene):
            _draw_queue(layout, scene, entries)
        layout.separator()
        film = session.of(scene)
        if film is None:
            _draw_closed_film(layout, scene)
        elif not is_aligned(scene):
            draw_text(layout, "The other frames are found by this one: align it first.", icon="INFO")
        else:
            _draw_film(layout, scene, film)


def _draw_queue(layout: bpy.types.UILayout, scene: bpy.types.Scene, entries: tuple[queued.Queued, ...]) -> None:
    here = queued.position(scene)
    counts = {state: sum(entry.state == state for entry in entries) for state in ICONS}
    layout.label(text=f"Frame {here + 1} of {len(entries)}, {counts.pop(CHECKED)} checked")
    layout.label(text=", ".join(f"{count} {state}" for state, count in counts.items() if count))
    column = layout.column(align=True)
    first = max(0, min(here - AROUND, len(entries) - 2 * AROUND - 1))
    for at, entry in list(enumerate(entries))[first : first + 2 * AROUND + 1]:
        row = column.row(align=True)
        row.template_icon(0 if entry.image is None else _picture(str(entry.image)), scale=1.6)
        cell = row.column(align=True)
        cell.scale_y = 1.6
        icon = ICONS.get(entry.state, "CANCEL")
        cell.operator("oneframe.queue_step", text=entry.path.parent.name, icon=icon, depress=at == here).step = (
            at - here
        )
    if scene.oneframe.refused:
        draw_text(layout, f"Refused: {scene.oneframe.refused}", icon="CANCEL")
    for operator, text, icon, settings in (
        ("queue_step", "Previous", "TRIA_UP", {"step": -1}),
        ("queue_step", "Next", "TRIA_DOWN", {"step": 1}),
        ("queue_check", "Checked", "CHECKMARK", {}),
        ("queue_unfinished", "Next Unfinished", "FRAME_NEXT", {}),
    ):
        row = layout.row(align=True)
        button = row.operator(f"oneframe.{operator}", text=text, icon=icon)
        for name, value in settings.items():
            setattr(button, name, value)
        draw_key(row, f"oneframe.{operator}", **settings)
    layout.operator("oneframe.queue_refuse", icon="CANCEL")


def _draw_closed_film(layout: bpy.types.UILayout, scene: bpy.types.Scene) -> None:
    if path := film_poses.film_of_case(scene):
        layout.operator("oneframe.open_video", text=f"Open {path.name}", icon="FILE_MOVIE").filepath = str(path)
        return
    draw_text(layout, "Open the film of the frame, or another of the same surface and zoom.", icon="INFO")
    layout.operator("oneframe.open_video", icon="FILE_MOVIE")


def _draw_film(layout: bpy.types.UILayout, scene: bpy.types.Scene, film: FilmSession) -> None:
    registered, frame = film_poses.of(scene), film_poses.frame_at(scene, film.shown)
    layout.operator("oneframe.register_frames", icon="CON_CAMERASOLVER")
    if registered is not None:
        numbers = [score.index for score in film.scores.frames]
        count = sum(number in registered.frames for number in numbers)
        part = "" if count == len(numbers) else f"{count} of {len(numbers)}: "
        by = registered.reference.name
        origin = "" if by == bpy.path.basename(scene.oneframe.frame_path) else f" By {by}."
        draw_text(layout, f"{part}{registered.summary()}.{origin}", lines=2)
        row = layout.row(align=True)
        row.operator("screen.animation_play", text="Play", icon="PLAY")
        row.operator("oneframe.queue_found", text="To Queue", icon="ADD")
    if frame_in_view.other(scene) is None:
        text = "Go along the Timeline below the view to see a frame with the surface at its pose."
        if registered is None:
            text = "No frame is registered from the present pose."
    elif frame is None:
        text = f"Frame {film.score.index}: not registered, so it is shown without the surface."
    else:
        reason = frame.verdict.reason
        text = f"Frame {film.score.index}: {film_poses.text_of(frame.verdict)}. {reason[:1].upper()}{reason[1:]}."
    draw_text(layout, text, lines=TEXT_LINES)
    row = layout.split(factor=0.85, align=True)
    row.operator("oneframe.case_frame", icon="LOOP_BACK")
    draw_key(row, "oneframe.case_frame")


def _picture(name: str) -> int:
    if not _pictures:
        _pictures["queue"] = bpy.utils.previews.new()
    known = _pictures["queue"]
    picture = known[name] if name in known else known.load(name, name, "IMAGE")
    return picture.icon_id


def _forget() -> None:
    if _pictures:
        bpy.utils.previews.remove(_pictures.pop("queue"))


HEIGHT = 5
"""At interface scale 1."""


class FoundBand(Pane):
    """At the bottom of the Timeline, a frame wide for each; lost ones lie over the others, where a pixel holds many."""

    space = bpy.types.SpaceDopeSheetEditor

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return film_poses.of(context.scene) is not None

    @classmethod
    def draw(cls, context: bpy.types.Context, strokes: Strokes) -> None:
        registered, view = film_poses.of(context.scene), context.region.view2d
        first, last = (np.array(view.view_to_region(x, 0.0, clip=False), float)[0] for x in (0.0, 1000.0))
        per_frame = (last - first) / 1000
        shader = gpu.shader.from_builtin("UNIFORM_COLOR")
        for state in film_poses.WORDS:
            frames = () if registered is None else registered.frames.items()
            numbers = np.array([number for number, frame in frames if frame.verdict.state == state], float)
            left = first + per_frame * (numbers - 0.5)
            right, low = np.maximum(left + per_frame, left + 1), np.zeros(len(left))
            high = low + HEIGHT * strokes.unit
            corners = [(left, low), (right, low), (right, high), (left, low), (right, high), (left, high)]
            points = np.stack([np.stack(corner, axis=-1) for corner in corners], axis=1).reshape(-1, 2)
            if len(points):
                shader.bind()
                shader.uniform_float("color", (*(value / 255 for value in COLOURS[state]), 1.0))
                batch_for_shader(shader, "TRIS", {"pos": np.float32(points)}).draw(shader)


PARTS = (at_end(_forget),)
