"""The line on top of the workbench's largest 3D view: which case, saved or not, how good its pose is, what comes next.

What is in doubt follows it in red. It draws only, and looks at no file that has not changed.
"""

from pathlib import Path

import bpy
import numpy as np

from ..case_queue.operators import SETTLED
from ..dataset import background_job
from ..dataset.output import usual_output
from ..landmarks import solve
from ..pipeline.alignment.landmarks.align_landmarks import complete_landmarks
from ..pipeline.case.pose_record import (
    FURTHER_FRAMES,
    INITIAL_GUESS,
    OTHER_FRAME,
    REGISTERED,
    PoseRecord,
)
from ..pipeline.files.numbers import format_two_digits
from ..setup.alignment_record import doubts, pose_record
from ..setup.case_in_scene import unsaved_parts
from ..setup.open_case import task_lines
from ..setup.queued import position, queue_of
from ..state import frame_in_view, from_scene, pose, workbench
from ..state.events import areas
from ..state.landmarks import landmarks_model
from ..ui.keymap import binding
from ..ui.pane import Pane
from ..ui.strokes import Colour, Strokes
from ..view.zoom import STATUS_PX, uncovered_rectangle
from . import operator
from .preview import error_text, preview_text

PLAIN: Colour = (1.0, 1.0, 1.0, 1.0)
DOUBT: Colour = (1.0, 0.45, 0.35, 1.0)
NAVIGATION_PX = 90.0
"""Width of Blender's navigation in the upper right corner of a view, at interface scale 1."""
LARGEST_SHARE = 0.35
"""Of the view's height, for texts on top of it."""
FEWEST_PINS = 3
"""From which on pins hold the surface in all directions: a refinement begins near enough."""
CONTRADICTION = 10.0
"""RMS of the pins in units of the click noise from which on they cannot be meant so."""

KINDS = {
    "landmarks": "From landmarks",
    "pins": "Pulled by pins",
    "refined": "Refined against the image",
    FURTHER_FRAMES: "From further frames",
    REGISTERED: "Registered to another frame",
    "manual": "By hand",
    INITIAL_GUESS: "Initial guess, not aligned",
    OTHER_FRAME: "Of another frame, not aligned in this one",
}
"""Method of a record -> its description."""


def status(scene: bpy.types.Scene) -> tuple[str, tuple[str, ...]]:
    """The line, and what is in doubt."""
    settings = scene.oneframe
    name = bpy.path.basename(settings.case_path or settings.frame_path) or "New case"
    if entries := queue_of(scene):
        name = f"{Path(settings.case_path).parent.name} ({position(scene) + 1} of {len(entries)})"
    parts = unsaved_parts(scene)
    saved = f"not saved: {', '.join(parts)}" if parts else "saved" if settings.case_path else "not saved"
    if (other := frame_in_view.other(scene)) is not None:
        back = f"{binding('oneframe.case_frame') or 'Back to Case Frame'}: back to the case's frame"
        return f"{name}, {saved}  |  In view: {other.name}, {other.text}  |  {back}", ()
    line = f"{name}, {saved}  |  {pose_text(scene)}"
    step = next_step(scene, is_saved=saved == "saved")
    return f"{line}  |  {step}" if step else line, doubts(scene)


def pose_text(scene: bpy.types.Scene) -> str:
    """How the shown pose was found, and its error."""
    found = operator.outcome(scene)
    if found is not None and operator.is_previewed(scene):
        return f"{preview_text(found)}, off by {error_text(found, refined=True)}"
    if pose.previewed:
        return f"Preview: {pose.previewed}"
    record = pose_record(scene)
    text = KINDS.get(record.method, record.method or "From the case file")
    text = "Taken although refused" if record.refused else text
    if record.error_px is not None:
        return f"{text}, off by {'at least' if record.refused else 'about'} {format_two_digits(record.error_px)} px"
    rms_px = _rms_px(scene, record)
    return f"{text}, RMS of the pairs {rms_px:.2f} px" if np.isfinite(rms_px) else text


def _rms_px(scene: bpy.types.Scene, record: PoseRecord) -> float:
    """The residual of the pairs at the shown pose, NaN if there are none."""
    if record.rms_px is None and complete_landmarks(landmarks_model(scene)):
        return solve.rms_px(scene, from_scene.cam_from_model(scene))
    return np.nan if record.rms_px is None else record.rms_px


def next_step(scene: bpy.types.Scene, *, is_saved: bool) -> str:
    """What the user does next."""
    job = background_job.current()
    if job is not None and job.running:
        # Blender's own question before it quits cannot say so
        again = "" if job.out == usual_output(scene) else f" to {job.out.name}"
        when = "next time" if is_saved else "next time once the case is saved"
        return f"A dataset renders: quitting stops it, Render Dataset{again} continues it {when}"
    if missing := workbench.next_step(scene):
        return missing
    found, record = operator.outcome(scene), pose_record(scene)
    if pose.previewed or operator.is_previewed(scene):
        return "Esc: go back" if found is not None and found.can_be_taken else "Enter: keep it, Esc: go back"
    if found is not None and not found.accepted and not operator.is_taken(scene):
        return f"Refused: {found.objection}; add landmarks" if found.objection else found.message
    if len(solve.solution(scene).doubtful) > 1:
        return f"{binding('oneframe.other_pose') or 'Other Pose'}: the other pose"
    if record.is_start or record.doubt:
        return "Next: drag pins or pick landmarks"
    if record.method == "pins" and _rms_px(scene, record) > CONTRADICTION * scene.oneframe.click_sigma_px:
        return "The pins contradict each other: move or delete the worst ones"
    if record.method == "pins" and (record.pairs or 0) < FEWEST_PINS:
        return "Next: drag another pin, far from the first"
    entries, is_settled = queue_of(scene), bool(record.checked or scene.oneframe.refused)
    if not record.is_from_image and not is_settled:
        return f"Next: {binding('oneframe.refine') or 'Refine Against Image'} refines it"
    if entries:
        if not is_saved or not (is_settled or entries[position(scene)].state in SETTLED):
            return f"Next: {binding('oneframe.queue_check') or 'Checked'}, if it is right"
        if any(entry.state not in SETTLED for entry in entries):
            return f"Next: {binding('oneframe.queue_unfinished') or 'Next Unfinished'} goes to the next unfinished one"
        return f"Next: oneframe render {entries[0].path.parents[1].name}, which renders them all"
    return "Next: Render Dataset" if is_saved else "Next: Save Case"


class StatusLine(Pane):
    """On top of the largest 3D view of a window."""

    order = 2

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        views = [area for window, area in areas("VIEW_3D") if window == context.window]
        return from_scene.is_set_up(context.scene) and context.area == max(views, key=lambda area: area.width)

    @classmethod
    def draw(cls, context: bpy.types.Context, strokes: Strokes) -> None:
        (line, in_doubt), task = status(context.scene), task_lines(context.scene)
        is_refused = bool(pose_record(context.scene).refused)
        low, high = uncovered_rectangle(context.area)
        margin, row = 10 * strokes.unit, STATUS_PX * strokes.unit
        at = np.array([low[0] + margin, high[1] - 16 * strokes.unit])
        room = high[0] - at[0] - margin - (NAVIGATION_PX * strokes.unit if _has_navigation(context) else 0.0)
        most = max(2, int(LARGEST_SHARE * (high[1] - low[1]) / row))
        texts = (
            (line, DOUBT if is_refused else PLAIN),
            *((text, DOUBT) for text in in_doubt),
            *((text, PLAIN) for text in task),
        )
        for number, (text, colour) in enumerate(texts):
            lines = strokes.wrapped(text, room)
            if len(lines) > most:
                if number:
                    break  # what is in doubt stands in the sidebar too
                lines = [*lines[: most - 1], f"{lines[most - 1]} ..."]
            most -= len(lines)
            for each in lines:
                strokes.text(at, each, colour)
                at = at - [0.0, row]


def _has_navigation(context: bpy.types.Context) -> bool:
    """Whether Blender draws its balls and icons for navigation in the corner."""
    space = context.space_data
    is_shown = isinstance(space, bpy.types.SpaceView3D) and space.show_gizmo and space.show_gizmo_navigate
    return is_shown and context.preferences.view.mini_axis_type == "GIZMO"
