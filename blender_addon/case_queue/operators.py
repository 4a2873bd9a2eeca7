"""Operators that put frames into a queue, step through it, and mark a pose as checked."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import bpy
from bpy.props import BoolProperty, IntProperty, StringProperty
from bpy_extras.io_utils import ImportHelper

from ..class_registration import class_registration, prop
from ..pipeline.blender.alignment import surface_object
from ..pipeline.case.alignment_record import OTHER_FRAME
from ..pipeline.case.case_file import read_case
from ..pipeline.case.case_folder import CASE
from ..pipeline.case.case_queue import add_frames
from ..pipeline.errors import InputError
from ..pipeline.files.outputs import made_folder
from ..pipeline.video.frame_folder import write_frame
from ..setup.alignment_record import is_start
from ..setup.frame import IMAGES
from ..setup.open_case import load_into_scene, unsaved_parts
from ..setup.save_case import REPLACE, replaced_pose
from ..setup.undone_saves import undoable
from ..state import camera_view, from_scene, pose_evidence
from ..state.scene_files import forget_stamps
from ..ui.background_operator import InBackground, Work
from ..ui.keymap import Key, keys
from ..ui.operator import ChosenFiles, Messages, NeedsAlignment, OperatorResult, Reporting, available, call, open_beside
from ..ui.question import ask_first
from ..video import session
from ..video.operators import NeedsFilm
from . import queued


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
        count = len(add_to_queue(context.scene, [(path, None) for path in images]))
        return (f"{count} frames are in the queue {queued.new_folder(context.scene)}",)


class ONEFRAME_OT_queue_video_frames(InBackground, NeedsFilm):
    """Put the video's frame in view into the queue, or its best frames"""

    bl_label = "Add Video Frame"
    bl_options = {"REGISTER"}
    doing = "Taking the frames"

    best: bool = prop(BoolProperty, "Best", "The best frames instead of the one in view", options={"SKIP_SAVE"})

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        is_set_up = available(cls, from_scene.is_set_up(context.scene), "Set up a frame, a camera and a surface first")
        return is_set_up and super().poll(context)

    def work(self, context: bpy.types.Context) -> Work:
        film = session.scored(context.scene)
        folder = queued.new_folder(context.scene)
        chosen = [film.scores.frames[at] for at in film.best] if self.best else [film.score]

        def take(progress: Callable[[float], None]) -> list[tuple[Path, tuple[str, int]]]:
            taken = []
            for number, score in enumerate(chosen):
                progress(number / len(chosen))
                image = write_frame(film.path, made_folder(folder / "frame").parent, film.scores, score)
                taken.append((image, (film.path.name, score.index)))
            return taken

        return take

    def finish(self, context: bpy.types.Context, result: Any) -> Messages:
        added = add_to_queue(context.scene, result)
        return (f"in the queue: {', '.join(path.parent.name for path in added)}",)


class _InQueue(Reporting):
    """Mixin: available in a queue."""

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return available(cls, bool(queued.queue_of(context.scene)), "Add frames to a queue first")


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
        go_to(context, entries[target].path)
        return (f"frame {target + 1} of {len(entries)}: {entries[target].path.parent.name}",)


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
        with undoable(scene, path):
            call("save_case", filepath=str(path), checked=True)
        record, uncertainty = read_case(path).alignment, pose_evidence.remembered_uncertainty(scene)
        pose_evidence.remember(scene, record, from_scene.cam_from_model(scene), uncertainty)
        if queued.position(scene) + 1 == len(queued.queue_of(scene)):
            return ("checked; this is the last frame of the queue",)
        call("queue_step")
        return ()


def add_to_queue(scene: bpy.types.Scene, frames: list[tuple[Path, tuple[str, int] | None]]) -> list[Path]:
    """Put frames into the scene's queue, which begins with the present case: see :func:`.add_frames`.

    Raises
    ------
    InputError, RunError
        As there, or the present case cannot be saved.
    """
    folder = queued.new_folder(scene)
    path = queued.present(scene)
    if path is None or path.parent.parent != folder:
        path = folder / Path(scene.oneframe.frame_path).stem / CASE
        call("save_case", filepath=str(made_folder(path)))
    added = add_frames(folder, read_case(path, posed=False), frames)
    forget_stamps()
    return added


def save_present(scene: bpy.types.Scene) -> None:
    """Save the scene's case to its file, unless only a start of its pose is new."""
    parts = unsaved_parts(scene)
    if parts and not (parts == ("pose",) and is_start(scene)):
        with undoable(scene, from_scene.absolute_path(scene.oneframe.case_path)):
            call("save_case", filepath=scene.oneframe.case_path)


def _question(scene: bpy.types.Scene) -> str:
    path = queued.present(scene)
    return "" if path is None or bpy.app.background else replaced_pose(scene, path)


def go_to(context: bpy.types.Context, path: Path) -> None:
    """Open a case of the queue. One without a pose starts from the present pose, if the surface is the same."""
    scene = context.scene
    surface = from_scene.surface_of(scene)
    mesh, pose = from_scene.absolute_path(surface.oneframe.mesh_path), from_scene.cam_from_model(scene)
    name, was_start = Path(scene.oneframe.frame_path).name, is_start(scene)
    case = read_case(path, posed=False)
    spaces = [area.spaces.active for area in camera_view.views(context)]
    through = [space for space in spaces if space.region_3d.view_perspective == "CAMERA"]
    load_into_scene(context, case)
    call("offer_unsaved")
    for space in through:  # the camera is a new one: Blender has left it
        space.region_3d.view_perspective = "CAMERA"
        camera_view.aim(scene, space)
    if case.posed or not case.mesh.samefile(mesh):
        return
    record: dict[str, object] = {"method": OTHER_FRAME, "doubt": f"found in another frame ({name})"}
    if was_start:
        record = {"method": OTHER_FRAME, "doubt": "found in an earlier frame"}
    surface_object.set_pose(scene.oneframe.camera_object, from_scene.surface_of(scene), pose)
    pose_evidence.remember(scene, record, pose)


register, unregister = class_registration(
    __name__,
    keys(
        Key("oneframe.queue_step", "PAGE_DOWN", properties=(("step", 1),)),
        Key("oneframe.queue_step", "PAGE_UP", properties=(("step", -1),)),
        Key("oneframe.queue_check", "PAGE_DOWN", ctrl=True),
    ),
)
