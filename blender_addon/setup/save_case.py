"""The operator that saves the case, with the files that were made in this session, and on request all others."""

import datetime
import getpass
import json
import os
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import bpy
from bpy.props import BoolProperty, StringProperty
from bpy_extras.io_utils import ExportHelper

from ..class_registration import prop
from ..pipeline.case.case_changes import other_inputs
from ..pipeline.case.case_file import read_case
from ..pipeline.case.case_folder import FRAME, KeptFile, check_new, keep_files, kept_mesh, made_by_file
from ..pipeline.case.case_history import add_to_history, history_path
from ..pipeline.case.case_writer import case_output, case_text, write_case
from ..pipeline.case.frame import read_frame
from ..pipeline.case.surface_folder import SURFACE, structure_file
from ..pipeline.errors import InputError
from ..pipeline.files.outputs import writing
from ..pipeline.transforms import is_same_pose
from ..state import from_scene, pose_evidence, to_scene
from ..state.case_of_file import case_of_file, remember_file
from ..state.events import redraw
from ..state.scene_files import forget_stamps, input_files, is_temporary, saved, usual_folder
from ..ui.operator import Messages, NeedsAlignment, OperatorResult, ReportingFile
from ..ui.question import ask_first
from ..volume.operators import made_by
from . import history
from .alignment_record import recorded_case

REPLACE = "Replace the Checked Pose?"


class ONEFRAME_OT_save_case(NeedsAlignment, ReportingFile, ExportHelper):
    """Save frame, K, surface, pose and landmarks as a case file, the input of render_dataset.py"""

    bl_label = "Save Case"
    bl_options = {"REGISTER"}

    filepath: str = prop(StringProperty, subtype="FILE_PATH", options={"SKIP_SAVE", "HIDDEN"})
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
        return self.execute(context) if known and not self.save_as else ExportHelper.invoke(self, context, event)

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
            settings: dict[str, Any] = {"filepath": str(path), "collect": self.collect, "is_answered": True}
            ask_first((REPLACE, question, "Replace"), "save_case", **settings)
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
    if other and _is_tied(scene, path) and (known := case_of_file(scene)):
        return other_inputs(path, replace(case, image=known.image, mesh=known.mesh))
    return other


def keep_beside(scene: bpy.types.Scene, folder: Path, *, collect: bool, replace: bool) -> list[Path]:
    """Copy files into the case's folder as ``oneframe case`` does, and use the copies.

    It gives the files in the folder that were copied or written.

    Parameters
    ----------
    folder
        The case's; files in it stay as they are.
    collect
        Copy all files, and not only those that end with this session and the frame that was taken from a video.
    replace
        The folder is that of the case that is saved: files with other content than those of the same names get one of
        their content, since these may be the user's own.
    """

    frame = from_scene.absolute_path(scene.oneframe.frame_path)
    from_video = scene.oneframe.frame_path == scene.oneframe_video.taken_path

    def is_kept(path: Path) -> bool:
        elsewhere = folder.resolve() not in path.resolve().parents
        return is_temporary(path) or (elsewhere and (collect or (from_video and path == frame)))

    kept: list[tuple[KeptFile, Callable[[str], None]]] = []
    inputs = {name: path for name, path in input_files(scene).items() if name != "case" and not is_kept(path)}
    if is_kept(frame):
        target = folder / (frame.name if from_video and not collect else FRAME)
        kept.append(
            (KeptFile(target, read_frame(frame).encoded()), lambda path: to_scene.relink_frame(scene, Path(path)))
        )
    surface, before_surface = from_scene.surface_of(scene), len(kept)
    for made in (surface, *(child for child in surface.children if child.oneframe.role == "STRUCTURE")):
        source = from_scene.absolute_path(made.oneframe.mesh_path)
        if is_kept(source):
            target = folder / (SURFACE if made == surface else structure_file(made.name))
            kept.append((kept_mesh(source, target), _relinked(made)))
    if replace:
        kept = [(file.beside(), relink) for file, relink in kept]
    files = [file for file, _ in kept]
    record, mesh = made_by(scene), from_scene.absolute_path(surface.oneframe.mesh_path)
    if is_kept(mesh):
        mesh = files[before_surface].path
    if record is not None and mesh.resolve().parent == folder.resolve():
        files.append(KeptFile(made_by_file(mesh), (json.dumps(record, indent=2) + "\n").encode()))
    if not replace:
        check_new(files, "choose another folder")
    keep_files(files, inputs)
    for file, relink in kept:
        relink(str(file.path.resolve()))
    if from_video:
        scene.oneframe_video.taken_path = scene.oneframe.frame_path
    return [each.path for each in files]


def _relinked(made: bpy.types.Object) -> Callable[[str], None]:
    def relink(path: str) -> None:
        made.oneframe.mesh_path = path

    return relink
