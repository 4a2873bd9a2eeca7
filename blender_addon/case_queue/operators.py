"""Operators that put frames into a queue, all or none, step through it, and mark a pose as checked."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import bpy
from bpy.props import IntProperty, StringProperty
from bpy_extras.io_utils import ImportHelper

from ..class_registration import prop
from ..pipeline.blender.alignment import surface_object
from ..pipeline.case.case_file import Case, read_case
from ..pipeline.case.case_folder import CASE
from ..pipeline.case.case_queue import CHECKED, REFUSED, NewFrame, add_frames, cases_of_frames
from ..pipeline.case.pose_record import OTHER_FRAME, PoseRecord
from ..pipeline.errors import InputError, naming
from ..pipeline.files.outputs import made_folder
from ..setup import history, queued
from ..setup.alignment_record import is_start
from ..setup.case_in_scene import unsaved_parts
from ..setup.operators import IMAGES
from ..setup.save_case import REPLACE, checked_pose
from ..state import camera_view, from_scene, pose_evidence
from ..state.scene_files import forget_stamps
from ..ui.keymap import Key, keys
from ..ui.operator import ChosenFiles, Messages, NeedsAlignment, OperatorResult, Reporting, call, open_beside
from ..ui.question import ask_first

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
            ask_first((REPLACE, question, "Replace"), "queue_step", step=self.step)
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
            ask_first((REPLACE, question, "Replace"), "queue_check")
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
    if unsaved_parts(scene):
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


class ONEFRAME_OT_queue_frames(NeedsAlignment, Reporting, ChosenFiles, ImportHelper):
    """Put frames of this surface and K into a queue, a case each; the present case is one of them"""

    bl_label = "Add Frames"
    bl_options = {"REGISTER"}

    filter_glob: str = prop(StringProperty, default=IMAGES, options={"HIDDEN"})
    filepath: str = prop(StringProperty, subtype="FILE_PATH", options={"SKIP_SAVE", "HIDDEN"})

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> OperatorResult:
        open_beside(self, context.scene)
        return ImportHelper.invoke(self, context, event)

    def run(self, context: bpy.types.Context) -> Messages:
        images = self.chosen_files()
        if not images:
            raise InputError("expected frames, found none chosen; choose image files")
        return added_text(context.scene, add_to_queue(context.scene, [NewFrame(path) for path in images]))


def first_case(scene: bpy.types.Scene) -> Case:
    """The scene's case where it will be in the queue."""
    from_scene.check_mesh_unedited(scene)
    folder, path = queued.new_folder(scene), queued.present(scene)
    if path is None or path.parent.parent != folder:
        path = folder / Path(scene.oneframe.frame_path).stem / CASE
    return replace(from_scene.case(scene, path), path=path)


def add_to_queue(scene: bpy.types.Scene, frames: Sequence[NewFrame]) -> list[Path]:
    """Put frames into the scene's queue, which begins with the present case: see :func:`.add_frames`.

    Raises
    ------
    InputError, RunError
        As there, and nothing has changed then; or the present case cannot be saved.
    """
    first, folder = first_case(scene), queued.new_folder(scene)
    cases_of_frames(folder, first, frames)
    if first.path != queued.present(scene):
        call("save_case", filepath=str(made_folder(first.path)))
    # its files may be copies now
    added = add_frames(folder, read_case(first.path, posed=False), frames)
    forget_stamps()
    return added


def added_text(scene: bpy.types.Scene, added: Sequence[Path]) -> Messages:
    """What was added, in words."""
    names = ", ".join(path.parent.name for path in added[:3]) + (f" and {len(added) - 3} more" if added[3:] else "")
    return (f"in the queue {queued.new_folder(scene)}: {names}",)


PARTS = (
    keys(
        Key("oneframe.queue_step", "PAGE_DOWN", properties=(("step", 1),)),
        Key("oneframe.queue_step", "PAGE_UP", properties=(("step", -1),)),
        Key("oneframe.queue_unfinished", "PAGE_DOWN", shift=True),
        Key("oneframe.queue_check", "PAGE_DOWN", alt=True),
    ),
)
