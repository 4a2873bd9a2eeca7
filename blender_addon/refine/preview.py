"""The preview of a refined pose: before and after in the view, until the user keeps one of them."""

from typing import Literal

import bpy
import numpy as np

from ..landmarks import solve
from ..pipeline.alignment.refinement.verdict import Refinement
from ..pipeline.errors import InputError, RunError
from ..pipeline.files.numbers import format_two_digits
from ..setup.alignment_record import pose_record, remember_refined
from ..state.events import redraw
from ..state.pose import set_cam_from_model
from ..ui.background_operator import NAVIGATION, show_status
from ..ui.operator import OperatorResult

KEEP, DISCARD = {"RET", "NUMPAD_ENTER", "LEFTMOUSE"}, {"ESC", "RIGHTMOUSE"}
TAKE = {"RET", "NUMPAD_ENTER"}
"""With Ctrl: takes a refused pose. It must not happen by a habit of the hand."""


def take(scene: bpy.types.Scene, result: Refinement, start: dict[str, object]) -> None:
    """Move the surface to the pose that a refinement has found, and record how; ``start``: of its initial pose.

    With landmarks it ends at the pose of both.
    """
    set_cam_from_model(scene, result.found)
    remember_refined(scene, result, start)
    solve.follow(scene)


class Preview(bpy.types.Operator):
    """Mixin: a modal operator that shows a refined pose and lets the user keep or discard it."""

    is_shown = False

    def show_result(self, context: bpy.types.Context, result: Refinement, start: np.ndarray) -> None:
        """Begin with the refined pose; ``start`` is the ``(4, 4)`` initial one, to which the preview can go back."""
        self._result, self._start, self.is_shown = result, start, True
        self._start_record = pose_record(context.scene)
        self._show_pose(context, is_result=True)
        self._show_figures(context)

    def _preview(self, context: bpy.types.Context, event: bpy.types.Event) -> OperatorResult:
        result = self._result
        if event.value == "PRESS":
            if event.type in DISCARD:
                self._show_pose(context, is_result=False)
                return self._close(context, "CANCELLED", message="the refined pose is discarded, the pose is unchanged")
            if (event.type in TAKE and event.ctrl) if result.can_be_taken else event.type in KEEP:
                take(context.scene, result, self._start_record)
                message = f"taken although refused: {result.objection}" if result.can_be_taken else result.message
                return self._close(context, "FINISHED", message=message)
            if event.type == "SPACE":
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
        """Called by Blender when it ends the operator: a file was opened, or the window closed."""
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
        show_status(context, None)
        if message:
            self.report({"INFO"}, message)
        if error:
            self.report({"ERROR"}, error)
        redraw()
        return {outcome}

    def _show_figures(self, context: bpy.types.Context) -> None:
        shown = "AFTER" if self._shows_result else "BEFORE"
        figures = _figures(self._result, refined=self._shows_result)
        show_status(context, f"{shown}: {figures}      {_keys(self._result)}")

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


def _figures(result: Refinement, *, refined: bool) -> str:
    agreement = result.after if refined else result.before
    return f"{agreement.score:.0%} of the image explained, off by {error_text(result, refined=refined)}"


def _keys(result: Refinement) -> str:
    if result.can_be_taken:
        return "REFUSED      Esc or Right Click: Discard      Ctrl + Enter: Take It Anyway      Space: Before / After"
    return "Enter or Left Click: Accept      Esc or Right Click: Discard      Space: Before / After"
