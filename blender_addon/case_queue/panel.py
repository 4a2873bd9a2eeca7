"""The panel Queue: the frames around the present one with pictures and states, and what goes on."""

from typing import Any

import bpy
import bpy.utils.previews

from ..class_registration import at_end
from ..pipeline.case.case_queue import ALIGNED, CHECKED, DOUBTFUL, NEW, ROUGH
from ..ui.keymap import draw_key
from ..ui.panel import AlignmentPanel
from . import queued

ICONS = {NEW: "RADIOBUT_OFF", ROUGH: "DOT", ALIGNED: "RADIOBUT_ON", CHECKED: "CHECKMARK", DOUBTFUL: "ERROR"}
"""State of a case -> its icon."""
AROUND = 3
"""Frames shown before and after the present one."""

_pictures: dict[str, Any] = {}
"""One collection of previews, once a queue is drawn."""


class ONEFRAME_PT_queue(AlignmentPanel):
    """Many frames of this surface, one after the other"""

    bl_parent_id = "ONEFRAME_PT_case"
    bl_label = "Queue"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context: bpy.types.Context) -> None:
        layout, entries = self.layout, queued.queue_of(context.scene)
        row = layout.row(align=True)
        row.operator_context = "INVOKE_DEFAULT"
        row.operator("oneframe.queue_frames", icon="ADD")
        row.operator("oneframe.queue_video_frames", text="", icon="FILE_MOVIE")
        row.operator("oneframe.queue_video_frames", text="Best", icon="FILE_MOVIE").best = True
        layout.operator_context = "INVOKE_DEFAULT"
        layout.operator("oneframe.queue_found", icon="CON_CAMERASOLVER")
        if not entries:
            return
        here = queued.position(context.scene)
        counts = [f"{sum(entry.state == state for entry in entries)} {state}" for state in ICONS]
        layout.label(text=f"Frame {here + 1} of {len(entries)}")
        layout.label(text=", ".join(count for count in counts if not count.startswith("0 ")))
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
        for name, step, icon in (("Previous", -1, "TRIA_UP"), ("Next", 1, "TRIA_DOWN")):
            row = layout.row(align=True)
            row.operator("oneframe.queue_step", text=name, icon=icon).step = step
            draw_key(row, "oneframe.queue_step", step=step)
        row = layout.row(align=True)
        row.operator("oneframe.queue_check", icon="CHECKMARK")
        draw_key(row, "oneframe.queue_check")
        row = layout.row(align=True)
        row.operator("oneframe.queue_unfinished", icon="FRAME_NEXT")
        draw_key(row, "oneframe.queue_unfinished")


def _picture(name: str) -> int:
    if not _pictures:
        _pictures["queue"] = bpy.utils.previews.new()
    known = _pictures["queue"]
    picture = known[name] if name in known else known.load(name, name, "IMAGE")
    return picture.icon_id


def _forget() -> None:
    if _pictures:
        bpy.utils.previews.remove(_pictures.pop("queue"))


PARTS = (at_end(_forget),)
