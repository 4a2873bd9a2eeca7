"""The operator that joins a mask to the frame: what it hides shows no surface."""

from pathlib import Path

import bpy
from bpy.props import StringProperty
from bpy_extras.io_utils import ImportHelper

from ..class_registration import class_registration, prop
from ..pipeline.blender.case.frame_file import read_frame
from ..pipeline.case.case_folder import keep_files
from ..state import from_scene, to_scene
from ..state.session_files import session_folder
from ..ui.operator import Messages, ReportingFile

MASKS = "*.png;*.tif;*.tiff;*.bmp"
_SUFFIX = "_masked"


class ONEFRAME_OT_load_mask(ReportingFile, bpy.types.Operator, ImportHelper):
    """Hide parts of the frame that show no surface: an image of its size, grey or with alpha, in which they are 0"""

    bl_idname = "oneframe.load_mask"
    bl_label = "Load Mask"
    bl_options = {"REGISTER", "UNDO"}

    filter_glob: str = prop(StringProperty(default=MASKS, options={"HIDDEN"}))

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        if context.scene.oneframe.frame_path:
            return True
        cls.poll_message_set("Load the frame first")
        return False

    def run(self, context: bpy.types.Context) -> Messages:
        path = from_scene.absolute_path(context.scene.oneframe.frame_path)
        frame = read_frame(path).with_mask(self.chosen_file())
        kept = frame.kept(session_folder() / f"{Path(path).stem.removesuffix(_SUFFIX)}{_SUFFIX}.png")
        keep_files([kept], {})
        to_scene.relink_frame(context.scene, kept.path)
        return (f"{frame.masked:.1%} of the frame masked; Load Frame again takes the mask off",)


register, unregister = class_registration((ONEFRAME_OT_load_mask,))
