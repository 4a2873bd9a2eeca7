"""The operators that save the case, alone or with all of its files, and one page about its alignment."""

import datetime
import os
from dataclasses import replace
from pathlib import Path

import bpy
import numpy as np
from bpy.props import BoolProperty, StringProperty

from ..class_registration import prop
from ..pipeline.case.case_file import Case, read_case
from ..pipeline.case.case_update import other_inputs, update_case
from ..pipeline.case.case_writer import case_output, write_case
from ..pipeline.case.pose_record import OTHER_FRAME
from ..pipeline.errors import InputError
from ..state import from_scene
from ..state.events import redraw
from ..state.known_case import known_case, remember_file
from ..state.scene_files import forget_stamps, input_files, saved, usual_folder
from ..ui.operator import Messages, NeedsAlignment, OperatorResult, SavesFile
from ..ui.question import ask_first
from . import autosave
from .alignment_record import doubts, recorded_case
from .kept_files import keep_beside


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

    replace: bool = prop(
        BoolProperty, "Replace", "Replace a case of another frame or surface", options={"SKIP_SAVE", "HIDDEN"}
    )
    in_doubt: bool = prop(
        BoolProperty, "In Doubt", "Save without asking about what is in doubt", options={"SKIP_SAVE", "HIDDEN"}
    )
    checked: bool = prop(
        BoolProperty, "Checked", "Note in the case that you have checked its pose", options={"SKIP_SAVE", "HIDDEN"}
    )

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> OperatorResult:
        settings = context.scene.oneframe
        known = bpy.path.abspath(settings.case_path)
        replaced = replaced_pose(context.scene, Path(known)) if known and not self.save_as else ""
        if not self.in_doubt and (doubtful := " ".join(filter(None, (replaced, *_doubts(context.scene))))):
            texts = (REPLACE, doubtful, "Replace") if replaced else ("Save in Doubt?", doubtful, "Save")
            ask_first(texts, "save_case", save_as=self.save_as, in_doubt=True)
            return {"CANCELLED"}
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
        from_scene.check_mesh_unedited(scene)
        # before any file is copied
        case_output(path)
        other, before = " and ".join(_other_case(scene, path)), input_files(scene)
        if other and not self.replace:
            if self.options.is_invoke and not bpy.app.background:
                question = f"{path.name} is the case of {other}. Replace it by the present one?"
                settings = {"filepath": str(path), "collect": self.collect, "replace": True}
                ask_first(("Replace Another Case?", question, "Replace"), "save_case", "EXEC_DEFAULT", **settings)
                return ()
            raise InputError(
                f"{path}: expected no file or a case of this frame and surface, found one of {other}; "
                "choose another name"
            )
        is_asked = self.options.is_invoke and not bpy.app.background and not self.in_doubt
        if is_asked and not other and (question := replaced_pose(scene, path)):
            settings = {"filepath": str(path), "collect": self.collect, "in_doubt": True}
            ask_first((REPLACE, question, "Replace"), "save_case", "EXEC_DEFAULT", **settings)
            return ()
        is_own = self.replace or _is_tied(scene, path)
        kept = keep_beside(scene, path.parent, collect=self.collect, replace=is_own)
        case = _with_kept_record(recorded_case(scene, path))
        if self.checked:
            case = replace(case, alignment=replace(case.alignment, checked=datetime.date.today().isoformat()))
        (write_case if other else update_case)(path, case)
        autosave.forget(scene)
        remember_file(scene, read_case(path))
        forget_stamps()
        for keep in saved:
            keep(scene)
        redraw()
        if input_files(scene) != before:
            # else undo would bring back the file before, for the next save
            bpy.ops.ed.undo_push(message=self.bl_label)
        return (f"saved {', '.join(map(str, (path, *kept)))}",)


REPLACE = "Replace the Pose?"


def replaced_pose(scene: bpy.types.Scene, path: Path) -> str:
    """The question before hands replace a pose in a case file that was found in the image or checked; else empty."""
    try:
        saved, case = read_case(path), recorded_case(scene, path)
    except InputError:
        return ""  # there is no file, or saving says what is wrong with the pose
    is_same = np.array_equal(saved.cam_from_mesh, case.cam_from_mesh)
    if is_same or not saved.alignment.is_settled or case.alignment.is_from_image:
        return ""
    how = "checked" if saved.alignment.checked else "found in the image or other frames"
    name = f"{path.parent.name}/{path.name}"
    return (
        f"The pose in {name} was {how}, the one in view was not. Replace it? The case's history keeps what is replaced."
    )


def _doubts(scene: bpy.types.Scene) -> tuple[str, ...]:
    try:
        return doubts(scene)
    except InputError:
        return ()  # saving says what is wrong with the pose


def _is_tied(scene: bpy.types.Scene, path: Path) -> bool:
    """Whether a file is that of the scene's case."""
    known = scene.oneframe.case_path
    return bool(known) and os.path.realpath(from_scene.absolute_path(known)) == os.path.realpath(path)


def _other_case(scene: bpy.types.Scene, path: Path) -> tuple[str, ...]:
    """What would be lost in a file that holds another case: its frame, its surface; see :func:`.other_inputs`.

    The scene's own file may name those that it had when it was read or written: a mask or a drill has changed them.
    """
    case = from_scene.case(scene, path)
    other = other_inputs(path, case)
    if other and _is_tied(scene, path) and (known := known_case(scene)):
        return other_inputs(path, replace(case, image=known.image, mesh=known.mesh))
    return other


def _with_kept_record(case: Case) -> Case:
    """The case with the record of its file, or with none if that has none, while the pose is the file's."""
    try:
        saved = read_case(case.path)
    except InputError:
        return case
    is_same = np.array_equal(saved.cam_from_mesh, case.cam_from_mesh) and case.alignment.method != OTHER_FRAME
    return replace(case, alignment=saved.alignment) if is_same else case
