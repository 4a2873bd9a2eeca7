"""The operator that saves the case, alone or with all of its files."""

import datetime
import getpass
import os
from dataclasses import replace
from pathlib import Path

import bpy
from bpy.props import BoolProperty, StringProperty

from ..class_registration import prop
from ..pipeline.case.case_changes import other_inputs
from ..pipeline.case.case_file import read_case
from ..pipeline.case.case_history import add_to_history, history_path
from ..pipeline.case.case_writer import case_output, case_text, write_case
from ..pipeline.errors import InputError
from ..pipeline.files.outputs import writing
from ..pipeline.transforms import is_same_pose
from ..state import from_scene, pose_evidence
from ..state.events import redraw
from ..state.known_case import known_case, remember_file
from ..state.scene_files import forget_stamps, input_files, saved, usual_folder
from ..ui.operator import Messages, NeedsAlignment, OperatorResult, SavesFile
from ..ui.question import ask_first
from . import history
from .alignment_record import recorded_case
from .kept_files import keep_beside

REPLACE = "Replace the Checked Pose?"


class ONEFRAME_OT_save_case(NeedsAlignment, SavesFile):
    """Save frame, K, surface, pose and landmarks as a case file, the input of render_dataset.py"""

    bl_label = "Save Case"
    bl_options = {"REGISTER"}

    filename_ext = ".toml"
    filter_glob: str = prop(StringProperty, default="*.toml", options={"HIDDEN"})

    save_as: bool = prop(
        BoolProperty, "Save As", "Ask for the file even if the case already has one", options={"SKIP_SAVE", "HIDDEN"}
    )
    collect: bool = prop(
        BoolProperty,
        "Copy Files",
        "Copy frame, surface and structures into the case's folder, as far as they lie elsewhere",
        options={"SKIP_SAVE"},
    )
    is_answered: bool = prop(
        BoolProperty, "Answered", "Replace a checked pose without asking", options={"SKIP_SAVE", "HIDDEN"}
    )
    checked: bool = prop(
        BoolProperty, "Checked", "Note in the case that you have checked its pose", options={"SKIP_SAVE", "HIDDEN"}
    )

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> OperatorResult:
        settings = context.scene.oneframe
        known = bpy.path.abspath(settings.case_path)
        usual = usual_folder(context.scene) / "case.toml"
        if usual.exists():
            # another one's, whose folder is not the place for copies
            usual = usual.with_name(f"{Path(settings.frame_path).stem}.toml")
        else:
            # a case begun from nothing becomes a folder with all of it
            self.collect = self.collect or not known
        self.filepath = known or str(usual)
        return self.execute(context) if known and not self.save_as else super().invoke(context, event)

    def run(self, context: bpy.types.Context) -> Messages:
        scene, path = context.scene, self.chosen_file()
        forget_stamps()
        from_scene.check_mesh_unedited(scene)
        # before any file is copied
        case_output(path)
        before, is_tied = input_files(scene), _is_tied(scene, path)
        if other := " and ".join(_other_case(scene, path)):
            raise InputError(
                f"{path}: expected no file or a case of this frame and surface, found one of {other}; "
                "choose another name"
            )
        is_asked = self.options.is_invoke and not bpy.app.background and not self.is_answered
        if is_asked and (question := checked_pose(scene, path)):
            settings = {"filepath": str(path), "collect": self.collect, "is_answered": True}
            ask_first((REPLACE, question, "Replace"), "save_case", "EXEC_DEFAULT", **settings)
            return ()
        case = recorded_case(scene, path)
        if is_tied and history.is_changed_elsewhere(scene):
            with writing(history_path(path)):
                add_to_history(path, case, case_text(path, case))
            return (
                f"{path.name} was saved by another window or program since it was opened here: yours is a further "
                "entry of its history, and not in the file. Open the case again to see both",
            )
        unnamed = None if is_tied else history.place_of(scene)
        kept = keep_beside(scene, path.parent, collect=self.collect, replace=is_tied)
        # its files may be copies now
        case = recorded_case(scene, path)
        if self.checked:
            day = f"{datetime.date.today().isoformat()}, {getpass.getuser()}"
            case = replace(case, alignment=replace(case.alignment, checked=day))
        write_case(path, case)
        in_file = read_case(path)
        remember_file(scene, in_file)
        if self.checked:
            uncertainty = pose_evidence.remembered_uncertainty(scene)
            pose_evidence.remember(scene, case.alignment, from_scene.cam_from_model(scene), uncertainty)
        forget_stamps()
        history.note(scene)
        if unnamed is not None and "case" not in before:
            history.carry_over(unnamed, in_file)
        for keep in saved:
            keep(scene)
        redraw()
        if input_files(scene) != before:
            # else undo would bring back the file before, for the next save
            bpy.ops.ed.undo_push(message=self.bl_label)
        return (f"saved {', '.join(map(str, (path, *kept)))}",)


def checked_pose(scene: bpy.types.Scene, path: Path) -> str:
    """The question before a pose that a person has checked is replaced in a case file by another one; else empty."""
    try:
        in_file, pose = read_case(path), from_scene.cam_from_mesh(scene)
    except InputError:
        return ""  # there is no file, or saving says what is wrong with the pose
    if not in_file.alignment.checked or is_same_pose(in_file.cam_from_mesh, pose):
        return ""
    name = f"{path.parent.name}/{path.name}"
    return f"The pose in {name} was checked ({in_file.alignment.checked}). Replace it by the one in view?"


def _is_tied(scene: bpy.types.Scene, path: Path) -> bool:
    """Whether a file is that of the scene's case."""
    known = scene.oneframe.case_path
    return bool(known) and os.path.realpath(from_scene.absolute_path(known)) == os.path.realpath(path)


def _other_case(scene: bpy.types.Scene, path: Path) -> tuple[str, ...]:
    """What would be lost in a file that holds another case: its frame, its surface; see :func:`.other_inputs`.

    The scene's own file may name those that it had when it was read or written: a mask has changed them.
    """
    case = from_scene.case(scene, path)
    other = other_inputs(path, case)
    if other and _is_tied(scene, path) and (known := known_case(scene)):
        return other_inputs(path, replace(case, image=known.image, mesh=known.mesh))
    return other
