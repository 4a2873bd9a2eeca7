"""The operators that refine a rough pose against the image: a preview to accept or discard, one undo step.

A refinement that does not improve the pose is refused. Its result can be looked at, and taken by choice: then the
record of the pose says so. Esc stops a refinement that runs.
"""

from functools import partial

import bpy
import numpy as np
from bpy.props import BoolProperty

from ..class_registration import at_end, class_registration, prop
from ..pipeline.alignment.refinement.verdict import Refinement
from ..pipeline.errors import InputError, RunError
from ..setup.alignment_record import pose_record
from ..state import from_scene, pose_evidence
from ..ui.background_work import POLL_SECONDS, BackgroundWork, check_inputs, inputs_of, show_status
from ..ui.keymap import Key, keys
from ..ui.operator import Messages, NeedsAlignment, OperatorResult, Reporting
from .preview import Preview, take
from .refined_pose import known_colours, refined


class ONEFRAME_OT_refine(NeedsAlignment, Reporting, Preview):
    """Refine the rough pose against the image, with a preview: Enter accepts it, Esc discards it"""

    bl_label = "Refine Pose"

    take_refused: bool = prop(
        BoolProperty,
        "Take Refused",
        "Without a preview: take the pose that was found even if it is refused",
        options={"SKIP_SAVE"},
    )

    def run(self, context: bpy.types.Context) -> Messages:
        """Refine without a preview, as scripts do."""
        scene = context.scene
        loaded = from_scene.loaded_case(scene, aligned=False)
        result = refined(loaded, known_colours(scene))
        _remember(result)
        taken = self.take_refused and result.can_be_taken
        if not result.accepted and not taken:
            raise InputError(result.message)
        take(scene, result, pose_record(scene))
        return (f"taken although refused: {result.objection}" if taken else result.message,)

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> OperatorResult:
        if context.window is None or bpy.app.background:
            return self.execute(context)
        try:
            loaded = from_scene.loaded_case(context.scene, aligned=False)
            colours = known_colours(context.scene)
        except (InputError, RunError) as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        self._start = loaded.cam_from_model
        self._inputs = inputs_of(context.scene)
        self._refining = BackgroundWork(partial(refined, loaded, colours))
        self._timer: bpy.types.Timer | None = context.window_manager.event_timer_add(
            POLL_SECONDS, window=context.window
        )
        context.window_manager.modal_handler_add(self)
        show_status(context, "Refining the pose      Esc: Stop")
        return {"RUNNING_MODAL"}

    def cancel(self, context: bpy.types.Context) -> None:
        """Called by Blender when it ends the operator: a file was opened, or the window closed."""
        self._refining.stop()
        self._stop_timer(context)
        super().cancel(context)

    def handle(self, context: bpy.types.Context, event: bpy.types.Event) -> OperatorResult:
        refining = self._refining
        if refining.running:
            if event.type == "ESC" and event.value == "PRESS":
                refining.stop()
                self._stop_timer(context)
                return self.end(context, "CANCELLED", message="refinement stopped, the pose is unchanged")
            show_status(context, f"Refining the pose: {refining.fraction:.0%}      Esc: Stop")
            return self.pass_navigation(event)
        began = self._timer is not None
        self._stop_timer(context)
        if refining.error is not None:
            raise refining.error
        result = refining.result
        if result is None:
            return self.end(context, "CANCELLED")
        if began:
            check_inputs(context.scene, self._inputs)
            _remember(result)
            if not result.accepted and not result.can_be_taken:
                return self.end(context, "CANCELLED", error=result.message)
            if not result.accepted:
                self.report({"WARNING"}, result.message)
            self.show_result(context, result, self._start)
        return self.preview(context, event)

    def _stop_timer(self, context: bpy.types.Context) -> None:
        if self._timer is not None:
            context.window_manager.event_timer_remove(self._timer)
            self._timer = None


class ONEFRAME_OT_take_refused(NeedsAlignment, Reporting, Preview):
    """Look at the pose that the refinement found and refused, before and after, and take it if it is right"""

    bl_label = "Look at Refused Pose"

    def run(self, context: bpy.types.Context) -> Messages:
        """Take it without a preview, as scripts do."""
        result = _refused(context.scene)
        take(context.scene, result, pose_record(context.scene))
        return (f"taken although refused: {result.objection}",)

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> OperatorResult:
        if context.window is None or bpy.app.background:
            return self.execute(context)
        try:
            self.show_result(context, _refused(context.scene), from_scene.cam_from_model(context.scene))
        except InputError as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        context.window_manager.modal_handler_add(self)
        return {"RUNNING_MODAL"}


def _refused(scene: bpy.types.Scene) -> Refinement:
    result = outcome(scene)
    if result is None or not result.can_be_taken or is_taken(scene):
        raise InputError("expected a refinement that was refused at this pose, found none; press Refine Against Image")
    return result


_last: Refinement | None = None
"""The latest refinement; valid for its two poses only."""


def _remember(result: Refinement | None) -> None:
    global _last
    _last = result


def outcome(scene: bpy.types.Scene) -> Refinement | None:
    """The latest refinement if the current pose is its result, or if it was refused at this pose; otherwise ``None``.

    Raises
    ------
    InputError
        There is no pose.
    """
    if _last is None:
        return None
    pose = from_scene.cam_from_model(scene)
    return _last if any(np.array_equal(pose, each) for each in (_last.cam_from_model, _last.found)) else None


def is_previewed(scene: bpy.types.Scene) -> bool:
    """Whether the current pose is that of a refinement that the user has not taken yet."""
    result = outcome(scene)
    if result is None or np.array_equal(from_scene.cam_from_model(scene), result.cam_from_model) != result.accepted:
        return False
    return pose_evidence.remembered(scene) is None


def is_taken(scene: bpy.types.Scene) -> bool:
    """Whether the current pose was refused by the refinement, and taken all the same."""
    return "refused" in (pose_evidence.remembered(scene) or {})


_CLASSES = (ONEFRAME_OT_refine, ONEFRAME_OT_take_refused)
register, unregister = class_registration(_CLASSES, keys(Key("oneframe.refine", "F")), at_end(lambda: _remember(None)))
