"""The operator that refines a rough pose against the image: a preview to accept or discard, one undo step.

A refinement that does not improve the pose is refused. Its result can be looked at, and taken by choice: then the
record of the pose says so. Esc stops a refinement that runs.
"""

from collections.abc import Callable
from functools import partial
from typing import Any

import bpy
import numpy as np
from bpy.props import BoolProperty

from ..class_registration import at_end, prop
from ..pipeline.alignment.refinement.refine import refine_pose
from ..pipeline.alignment.refinement.verdict import Refinement
from ..pipeline.case.loaded_case import LoadedCase
from ..pipeline.errors import InputError
from ..setup.alignment_record import pose_record
from ..state import from_scene, pose_evidence
from ..ui.background_operator import InBackground, Work, check_inputs, inputs_of
from ..ui.keymap import Key, keys
from ..ui.operator import Messages, NeedsAlignment, OperatorResult
from .preview import RefinementPreview, preview_text, take


class ONEFRAME_OT_refine(NeedsAlignment, InBackground, RefinementPreview):
    """Refine the rough pose against the image, with a preview: Enter accepts it, Esc discards it"""

    bl_label = "Refine Against Image"

    take_refused: bool = prop(
        BoolProperty,
        "Take Refused",
        "Without a preview: take the pose that was found even if it is refused",
        options={"SKIP_SAVE"},
    )

    doing = "Refining the pose"

    def run(self, context: bpy.types.Context) -> Messages:
        """Refine without a preview, as scripts do."""
        scene = context.scene
        loaded = from_scene.loaded_case(scene, aligned=False)
        result = _refinement_of(loaded)(progress=None)
        _remember(result, scene.oneframe.frame_path)
        taken = self.take_refused and result.can_be_taken
        if not result.accepted and not taken:
            raise InputError(result.message)
        take(scene, result, pose_record(scene))
        return (f"taken although refused: {result.objection}" if taken else result.message,)

    def work(self, context: bpy.types.Context) -> Work:
        loaded = from_scene.loaded_case(context.scene, aligned=False)
        self._start, self._inputs = loaded.frame.cam_from_model, inputs_of(context.scene)
        refinement = _refinement_of(loaded)
        return lambda progress: refinement(progress=progress)

    def finish(self, context: bpy.types.Context, result: Any) -> None:
        check_inputs(context.scene, self._inputs)
        _remember(result, context.scene.oneframe.frame_path)
        if not result.accepted and not result.can_be_taken:
            raise InputError(result.message)
        if not result.accepted:
            self.report({"WARNING"}, f"{preview_text(result)}: {result.objection}")
        self.show_result(context, result, self._start)

    def modal(self, context: bpy.types.Context, event: bpy.types.Event) -> OperatorResult:
        if self.is_shown:
            return RefinementPreview.modal(self, context, event)
        outcome = super().modal(context, event)
        return {"RUNNING_MODAL"} if self.is_shown else outcome

    def cancel(self, context: bpy.types.Context) -> None:
        super().cancel(context)
        RefinementPreview.cancel(self, context)


def _refinement_of(loaded: LoadedCase) -> Callable[..., Refinement]:
    """:func:`refine_pose` with the case's arrays, for any thread; it takes ``progress``."""
    frame = loaded.frame
    arrays = frame.image, frame.valid, loaded.case.camera, loaded.surface.mesh, frame.cam_from_model
    return partial(refine_pose, *arrays)


_latest: dict[str, Refinement] = {}
"""The frame of the latest refinement -> that refinement, which is valid for its two poses only."""


def _remember(result: Refinement, frame_path: str) -> None:
    _latest.clear()
    _latest[frame_path] = result


def outcome(scene: bpy.types.Scene) -> Refinement | None:
    """The latest refinement, in this frame, if the current pose is its result, or if it was refused at this pose."""
    pose, latest = from_scene.cam_from_model(scene), _latest.get(scene.oneframe.frame_path)
    if latest is None:
        return None
    return latest if any(np.array_equal(pose, each) for each in (latest.cam_from_model, latest.found)) else None


def is_previewed(scene: bpy.types.Scene) -> bool:
    """Whether the current pose is that of a refinement that the user has not taken yet."""
    result = outcome(scene)
    if result is None or np.array_equal(from_scene.cam_from_model(scene), result.cam_from_model) != result.accepted:
        return False
    return pose_evidence.remembered(scene) is None


def is_taken(scene: bpy.types.Scene) -> bool:
    """Whether the current pose was refused by the refinement, and taken all the same: not if the latest began at it."""
    result = outcome(scene)
    is_start = (
        result is not None
        and not result.accepted
        and np.array_equal(from_scene.cam_from_model(scene), result.cam_from_model)
    )
    if is_start or (record := pose_evidence.remembered(scene)) is None:
        return False
    return bool(record.refused)


PARTS = (keys(Key("oneframe.refine", "F")), at_end(_latest.clear))
