"""The preview of a pose that was found: before and after in the view, until the user keeps one of them."""

from contextlib import suppress
from typing import Literal

import bpy
import numpy as np

from ..pipeline.alignment.refinement.verdict import Refinement
from ..pipeline.case.pose_record import PoseRecord
from ..pipeline.errors import InputError, RunError
from ..pipeline.files.numbers import format_two_digits
from ..setup.alignment_record import pose_record, remember_refined
from ..state import pose
from ..state.events import redraw
from ..state.pose import set_cam_from_model
from ..ui.background_operator import NAVIGATION, show_status
from ..ui.operator import OperatorResult, report_error
from ..video import shown_frame

KEEP, DISCARD = {"RET", "NUMPAD_ENTER", "LEFTMOUSE"}, {"ESC", "RIGHTMOUSE"}
TAKE = {"RET", "NUMPAD_ENTER"}
"""With Ctrl: takes a refused pose. It must not happen by a habit of the hand."""


def take(scene: bpy.types.Scene, result: Refinement, start: PoseRecord) -> None:
    """Move the surface to the pose that a refinement has found, and record how; ``start``: of its initial pose."""
    set_cam_from_model(scene, result.found)
    remember_refined(scene, result, start)


class RefinementPreview(bpy.types.Operator):
    """Mixin: a modal operator that shows the pose of a refinement, and lets the user keep or discard it."""

    is_shown = False

    def show_result(self, context: bpy.types.Context, result: Refinement, start: np.ndarray) -> None:
        """Begin with the refined pose; ``start``, ``(4, 4)``, the one before, is that to go back to."""
        self._result, self._start_record, self._start = result, pose_record(context.scene), start
        self.is_shown = True
        pose.previewed = self.bl_label
        shown_frame.restore(context.scene)
        self._show_pose(context, is_result=True)
        self._show_figures(context)

    def _preview(self, context: bpy.types.Context, event: bpy.types.Event) -> OperatorResult:
        is_refused = self._result.can_be_taken
        if event.value == "PRESS":
            if event.type in DISCARD:
                self._show_pose(context, is_result=False)
                return self._close(context, "CANCELLED", message="the pose found is discarded, the pose is unchanged")
            if (event.type in TAKE and event.ctrl) if is_refused else event.type in KEEP:
                take(context.scene, self._result, self._start_record)
                message = f"taken although refused: {self._result.objection}"
                return self._close(context, "FINISHED", message=message if is_refused else self._result.message)
            if event.type == "PAGE_DOWN" and not is_refused:
                # on to the next frame of a queue: the key keeps its own effect
                take(context.scene, self._result, self._start_record)
                return self._close(context, "FINISHED", message=self._result.message) | {"PASS_THROUGH"}
            if event.type == "SPACE" and not (event.shift or event.ctrl or event.alt):
                self._show_pose(context, is_result=not self._shows_result)
        self._show_figures(context)
        return {"PASS_THROUGH"} if event.type in NAVIGATION else {"RUNNING_MODAL"}

    def modal(self, context: bpy.types.Context, event: bpy.types.Event) -> OperatorResult:
        try:
            return self._preview(context, event)
        except (InputError, RunError) as error:
            # the surface or the camera has been deleted
            return self._close(context, "CANCELLED", error=str(error))
        except Exception:
            self._close(context, "CANCELLED")
            raise

    def cancel(self, context: bpy.types.Context) -> None:
        """Called by Blender when it ends the operator: a file was opened, or the window closed; nobody took it."""
        if self.is_shown:
            with suppress(InputError):
                self._show_pose(context, is_result=False)
        self._close(context, "CANCELLED")

    def _close(
        self,
        context: bpy.types.Context,
        outcome: Literal["FINISHED", "CANCELLED"],
        *,
        message: str = "",
        error: str = "",
    ) -> OperatorResult:
        """Restore the headers, report, and end."""
        pose.previewed = ""
        show_status(context, None)
        if message:
            self.report({"INFO"}, message)
        if error:
            report_error(self, error)
        redraw()
        return {outcome}

    def _show_figures(self, context: bpy.types.Context) -> None:
        when = "AFTER" if self._shows_result else "BEFORE"
        keys = "Enter or Left Click: Accept      Esc or Right Click: Discard"
        if self._result.can_be_taken:
            keys = "REFUSED      Esc or Right Click: Discard      Ctrl + Enter: Take It Anyway"
        agreement = self._result.after if self._shows_result else self._result.before
        error = error_text(self._result, refined=self._shows_result)
        figures = f"{agreement.score:.0%} of the image explained, off by {error}"
        show_status(context, f"{when}: {figures}      {keys}      Space: Before / After")

    def _show_pose(self, context: bpy.types.Context, *, is_result: bool) -> None:
        set_cam_from_model(context.scene, self._result.found if is_result else self._start)
        self._shows_result = is_result
        redraw()


def preview_text(result: Refinement) -> str:
    """What the preview shows: never as the pose that the panels call unchanged."""
    return "Preview of a refused pose" if result.can_be_taken else "Preview of the refinement"


def error_text(result: Refinement, *, refined: bool) -> str:
    """The estimated error of the initial or of the refined pose."""
    error_px = (result.after if refined else result.before).error_px
    if not np.isfinite(error_px):
        return "unknown"
    return f"{'' if result.verified else '≥ '}{format_two_digits(error_px)} px"
