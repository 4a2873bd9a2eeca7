"""The operator that corrects the pose of the case's frame by the film's others: a preview to accept or discard."""

from typing import Any

import bpy

from ..pipeline.files.numbers import format_two_digits
from ..pipeline.registration.correct_source import CorrectedSource, correct_source
from ..refine.preview import BackgroundPreview
from ..setup.alignment_record import tool_and_date
from ..state import pose_evidence
from ..state.pose import set_cam_from_model
from ..ui.background_operator import Work, check_inputs, inputs_of
from ..ui.operator import Messages
from ..ui.step_panel import show
from ..video import session
from .operators import NeedsFrames, recorded_case


class ONEFRAME_OT_correct_first_pose(NeedsFrames, BackgroundPreview):
    """Correct the pose of the case's frame by others of the film, with a preview: Enter accepts it, Esc discards it"""

    bl_label = "Correct the First Pose"
    # without REGISTER: Adjust Last Operation would do it all again
    bl_options = {"UNDO"}
    doing = "Correcting the pose of the case's frame"
    step = "frames"

    def work(self, context: bpy.types.Context) -> Work:
        loaded, film = recorded_case(context.scene), session.scored(context.scene).path
        tool, date = tool_and_date()
        self._inputs, self._before = inputs_of(context.scene), loaded.frame.cam_from_model
        return lambda progress: correct_source(loaded, film, tool=tool, date=date, progress=progress)

    def run(self, context: bpy.types.Context) -> Messages:
        """Correct without a preview, as scripts do."""
        self._result: CorrectedSource = self.work(context)(lambda _fraction: None)
        return (self.keep(context),)

    def finish(self, context: bpy.types.Context, result: Any) -> None:
        check_inputs(context.scene, self._inputs)
        self._result = result
        self.show_poses(context, result.loaded.frame.cam_from_model, self._before)

    def keep(self, context: bpy.types.Context) -> str:
        scene, loaded = context.scene, self._result.loaded
        pose = loaded.frame.cam_from_model
        set_cam_from_model(scene, pose)
        # it belongs to the pose before
        pose_evidence.remember(scene, loaded.case.alignment, pose)
        show(scene, self.step)
        return self._result.text

    def figures(self, *, after: bool) -> str:
        return record_text(self._result.loaded.case.alignment) if after else "the pose as it was"


def record_text(record: dict[str, object]) -> str:
    """What a correction has moved, and how sure it is, from the record of the pose."""
    moved_deg, moved_px, error_px = (float(str(record[key])) for key in ("moved_deg", "moved_px", "error_px"))
    moved = f"moved by {moved_deg:.2g}° and {format_two_digits(moved_px)} px"
    return f"{moved}, off by about {format_two_digits(error_px)} px"
