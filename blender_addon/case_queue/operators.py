"""Operators that step through a queue, and mark a pose as checked."""

from pathlib import Path

import bpy
from bpy.props import IntProperty, StringProperty

from ..class_registration import prop
from ..pipeline.blender.alignment import surface_object
from ..pipeline.case.case_file import read_case
from ..pipeline.case.case_queue import CHECKED, REFUSED
from ..pipeline.case.pose_record import OTHER_FRAME, PoseRecord
from ..pipeline.errors import InputError, naming
from ..setup import history
from ..setup.alignment_record import is_start
from ..setup.case_in_scene import unsaved_parts
from ..setup.save_case import REPLACE, checked_pose
from ..state import camera_view, from_scene, pose_evidence
from ..ui.keymap import Key, keys
from ..ui.operator import Messages, OperatorResult, Reporting, call
from ..ui.question import ask_first
from . import queued

SETTLED = CHECKED, REFUSED
"""States of frames of which nothing is left to do."""


class _InQueue(Reporting):
    """Mixin: available in a queue."""

    needs = (lambda context: queued.queue_of(context.scene), "Add frames to a queue first")


class ONEFRAME_OT_queue_step(_InQueue):
    """Save this case and open another one of the queue; surface, view and tool stay, and the pose as a start"""

    bl_label = "Next Frame"
    bl_options = {"UNDO"}

    step: int = prop(IntProperty, default=1, options={"SKIP_SAVE", "HIDDEN"})

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> OperatorResult:
        if question := _question(context.scene):
            ask_first((REPLACE, question, "Replace"), "queue_step", "EXEC_DEFAULT", step=self.step)
            return {"CANCELLED"}
        return self.execute(context)

    def run(self, context: bpy.types.Context) -> Messages:
        entries = queued.queue_of(context.scene)
        target = queued.position(context.scene) + self.step
        if not 0 <= target < len(entries):
            raise InputError("this is the last frame of the queue" if target > 0 else "this is the first frame")
        save_present(context.scene)
        path = entries[target].path
        with naming(path.parent.name):
            go_to(context, path)
        return (f"frame {target + 1} of {len(entries)}: {path.parent.name}",)


class ONEFRAME_OT_queue_unfinished(_InQueue):
    """Save this case and open the next one that nobody has checked or refused: new, rough, in doubt or only aligned"""

    bl_label = "Next Unfinished"
    bl_options = {"UNDO"}

    def run(self, context: bpy.types.Context) -> Messages:
        entries, here = queued.queue_of(context.scene), queued.position(context.scene)
        after = [*range(here + 1, len(entries)), *range(here)]
        target = next((at for at in after if entries[at].state not in SETTLED), None)
        if target is None:
            is_last = entries[here].state not in SETTLED
            return ("this is the last frame that is not checked" if is_last else "all frames are checked",)
        # with its question
        call("queue_step", "EXEC_DEFAULT" if bpy.app.background else "INVOKE_DEFAULT", step=target - here)
        return ()


class ONEFRAME_OT_queue_check(_InQueue):
    """Save this case, note in it that you have checked its pose, and go to the next one"""

    bl_label = "Checked"
    bl_options = {"UNDO"}

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> OperatorResult:
        if question := _question(context.scene):
            ask_first((REPLACE, question, "Replace"), "queue_check", "EXEC_DEFAULT")
            return {"CANCELLED"}
        return self.execute(context)

    def run(self, context: bpy.types.Context) -> Messages:
        scene = context.scene
        if is_start(scene):
            raise InputError("expected a pose that was aligned in this frame, found only a start; align it first")
        path = queued.queue_of(scene)[queued.position(scene)].path
        call("save_case", filepath=str(path), checked=True)
        if queued.position(scene) + 1 == len(queued.queue_of(scene)):
            return ("checked; this is the last frame of the queue",)
        call("queue_step")
        return ()


class ONEFRAME_OT_queue_refuse(_InQueue):
    """Refuse this frame, with a reason: it is not rendered. Or take it back"""

    bl_label = "Refuse"
    bl_options = {"UNDO"}

    reason: str = prop(StringProperty, "Reason", "Why: blurred, a glove in front; empty takes the frame back")

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> OperatorResult:
        self.reason = context.scene.oneframe.refused
        # Blender's own dialog calls execute
        return context.window_manager.invoke_props_dialog(self, confirm_text="Save")  # type: ignore[return-value]

    def run(self, context: bpy.types.Context) -> Messages:
        scene = context.scene
        scene.oneframe.refused = self.reason.strip()
        call("save_case", filepath=scene.oneframe.case_path)
        return ("the frame is taken back" if not scene.oneframe.refused else "refused: it is not rendered",)


def save_present(scene: bpy.types.Scene) -> None:
    """Save the scene's case to its file, unless only a start of its pose is new."""
    parts = unsaved_parts(scene)
    if parts and not (parts == ("pose",) and is_start(scene)):
        call("save_case", filepath=scene.oneframe.case_path)


def _question(scene: bpy.types.Scene) -> str:
    path = queued.present(scene)
    return "" if path is None or bpy.app.background else checked_pose(scene, path)


def go_to(context: bpy.types.Context, path: Path) -> None:
    """Open a case of the queue. One without a pose starts from the present pose, if the surface is the same."""
    scene = context.scene
    surface = from_scene.surface_of(scene)
    mesh, pose = from_scene.absolute_path(surface.oneframe.mesh_path), from_scene.cam_from_model(scene)
    name, was_start = Path(scene.oneframe.frame_path).name, is_start(scene)
    case = read_case(path, posed=False)
    spaces = [area.spaces.active for area in camera_view.views(context)]
    through = [space for space in spaces if space.region_3d.view_perspective == "CAMERA"]
    history.load(context, path)
    for space in through:  # the camera is a new one: Blender has left it
        space.region_3d.view_perspective = "CAMERA"
        camera_view.aim(scene, space)
    if case.posed or not case.mesh.samefile(mesh):
        return
    origin = "an earlier frame" if was_start else f"another frame ({name})"
    record = PoseRecord(OTHER_FRAME, doubt=f"found in {origin}")
    surface_object.set_pose(scene.oneframe.camera_object, from_scene.surface_of(scene), pose)
    pose_evidence.remember(scene, record, pose)


PARTS = (
    keys(
        Key("oneframe.queue_step", "PAGE_DOWN", properties=(("step", 1),)),
        Key("oneframe.queue_step", "PAGE_UP", properties=(("step", -1),)),
        Key("oneframe.queue_unfinished", "PAGE_DOWN", shift=True),
        Key("oneframe.queue_check", "PAGE_DOWN", alt=True),
    ),
)
