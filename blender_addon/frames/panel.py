"""The step Frames: the other frames of the film, the correction of the first pose."""

import bpy

from ..pipeline.case.alignment_record import FURTHER_FRAMES
from ..setup.alignment_record import pose_record
from ..state import another_frame
from ..ui.keymap import draw_key
from ..ui.panel import AlignmentPanel, draw_text
from ..ui.step_panel import StepPanel
from ..video import session
from ..video.session import FilmSession
from . import found
from .correct import record_text
from .operators import is_aligned

TEXT_LINES = 3
"""Of what is said of the frame in view: no button moves under the pointer, here and above, when a text changes."""


class ONEFRAME_PT_frames(AlignmentPanel, StepPanel):
    """The other frames of the film"""

    bl_label = "6  Frames"
    bl_order = 7
    step = "frames"

    def draw_step(self, context: bpy.types.Context, layout: bpy.types.UILayout) -> None:
        scene, film = context.scene, session.of(context.scene)
        layout.operator_context = "INVOKE_DEFAULT"
        if not is_aligned(scene):
            draw_text(layout, "The other frames are found by this one: align it first.", icon="INFO")
            return
        if film is None:
            draw_text(layout, "Open the film of the frame, or another of the same surface and zoom.", icon="INFO")
            layout.operator("oneframe.open_video", icon="FILE_MOVIE")
            return
        layout.operator("oneframe.register_frames", icon="CON_CAMERASOLVER")
        _draw_found(layout, scene, film)
        row = layout.split(factor=0.85, align=True)
        row.operator("oneframe.case_frame", icon="LOOP_BACK")
        draw_key(row, "oneframe.case_frame")
        layout.separator()
        layout.operator("oneframe.correct_first_pose", icon="SNAP_ON")
        record = pose_record(scene)
        if record.get("method") == FURTHER_FRAMES:
            draw_text(layout, f"Corrected: {record_text(record)}, if the surface is right.", icon="CHECKMARK")


def _draw_found(layout: bpy.types.UILayout, scene: bpy.types.Scene, film: FilmSession) -> None:
    registered, frame = found.of(scene), found.frame_at(scene, film.shown)
    if registered is not None:
        numbers = [score.index for score in film.scores.frames]
        count = sum(number in registered.frames for number in numbers)
        part = "" if count == len(numbers) else f"{count} of {len(numbers)}: "
        by = registered.source.name
        origin = "" if by == bpy.path.basename(scene.oneframe.frame_path) else f" By {by}."
        draw_text(layout, f"{part}{registered.summary()}.{origin}", lines=2)
        if registered.check is not None and registered.check.words:
            draw_text(layout, f"T{registered.check.words[1:]}.", lines=4)
        row = layout.row(align=True)
        row.operator("oneframe.play_frames", icon="PLAY")
        row.operator("oneframe.queue_found", text="To Queue", icon="ADD")
    if another_frame.seen(scene) is None:
        text = "Go along the Timeline below the view to see a frame with the surface at its pose."
        if registered is None:
            text = "No frame is registered from the present pose."
    elif frame is None:
        text = f"Frame {film.score.index}: not registered, so it is shown without the surface."
    else:
        reason = frame.verdict.reason
        text = f"Frame {film.score.index}: {found.text_of(frame.verdict)}. {reason[:1].upper()}{reason[1:]}."
    draw_text(layout, text, lines=TEXT_LINES)
