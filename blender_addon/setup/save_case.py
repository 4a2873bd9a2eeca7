"""The operator that saves the case, alone or with all of its files."""

import json
from dataclasses import replace
from pathlib import Path

import bpy
import numpy as np
from bpy.props import BoolProperty, StringProperty
from bpy_extras.io_utils import ExportHelper

from ..pipeline.case.case_file import Case, read_case
from ..pipeline.case.case_update import update_case
from ..pipeline.case.case_writer import case_output
from ..pipeline.errors import InputError
from ..registration import class_registration, prop
from ..state import from_scene
from ..state.session_files import is_temporary
from ..ui.operator import Messages, NeedsAlignment, OperatorResult, ReportingFile
from .alignment_record import recorded_case
from .kept_files import keep_beside


class ONEFRAME_OT_save_case(NeedsAlignment, ReportingFile, bpy.types.Operator, ExportHelper):
    """Save frame, K, surface, pose and landmarks as a case file, the input of render_dataset.py"""

    bl_idname = "oneframe.save_case"
    bl_label = "Save Case"
    bl_options = {"REGISTER"}

    filename_ext = ".toml"
    filter_glob: str = prop(StringProperty(default="*.toml", options={"HIDDEN"}))

    save_as: bool = prop(
        BoolProperty(
            name="Save As",
            description="Ask for the file even if the case already has one",
            default=False,
            options={"SKIP_SAVE", "HIDDEN"},
        )
    )
    collect: bool = prop(
        BoolProperty(
            name="Copy Files",
            description="Copy frame, surface and structures into the case's folder, as far as they lie elsewhere",
            default=False,
            options={"SKIP_SAVE"},
        )
    )

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> OperatorResult:
        known = bpy.path.abspath(context.scene.oneframe.case_path)
        # a case begun from nothing becomes a folder with all of it
        self.collect = self.collect or not known
        self.filepath = known or str(_usual_folder(context.scene) / "case.toml")
        return self.execute(context) if known and not self.save_as else super().invoke(context, event)

    def run(self, context: bpy.types.Context) -> Messages:
        from_scene.check_mesh_unedited(context.scene)
        path, settings = self.chosen_file(), context.scene.oneframe
        # before any file is copied
        case_output(path)
        from_scene.case(context.scene, path)
        kept = keep_beside(context.scene, path.parent, collect=self.collect)
        update_case(path, _with_kept_record(recorded_case(context.scene, path)))
        settings.case_path, settings.case_dataset_text = str(path), json.dumps(read_case(path).dataset)
        return (f"saved {', '.join(map(str, (path, *kept)))}",)


def _usual_folder(scene: bpy.types.Scene) -> Path:
    """The folder of the frame, the surface or the CT: of the first that is no file of this session."""
    surface = from_scene.present_surface(scene)
    meshes = [] if surface is None else [surface.oneframe.mesh_path]
    for text in (scene.oneframe.frame_path, *meshes, scene.oneframe_ct.path):
        if text and not is_temporary(path := from_scene.absolute_path(text)):
            return path.parent
    return Path()


def _with_kept_record(case: Case) -> Case:
    """The case with the record of its file, or with none if that has none, while the pose is the file's."""
    try:
        saved = read_case(case.path)
    except InputError:
        return case
    is_same = np.array_equal(saved.cam_from_mesh, case.cam_from_mesh)
    return replace(case, alignment=saved.alignment) if is_same else case


register, unregister = class_registration((ONEFRAME_OT_save_case,))
