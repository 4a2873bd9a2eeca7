"""The operator that saves one page about the alignment."""

from dataclasses import replace

import bpy
from bpy.props import StringProperty

from ..class_registration import class_registration, prop
from ..pipeline.blender.render.lettering import text_mask
from ..pipeline.files.content import write_bytes_atomically
from ..pipeline.files.outputs import check_outputs
from ..pipeline.images.png import encode_png
from ..pipeline.overlay.overlay_picture import case_picture
from ..state import from_scene
from ..state.scene_files import input_files
from ..ui.operator import Messages, NeedsAlignment, SavesFile
from .alignment_record import pose_record


class ONEFRAME_OT_save_record(NeedsAlignment, SavesFile):
    """Save one page about the alignment, with names of files: frame, overlay, residuals, uncertainty, origin"""

    bl_label = "Save Record"
    bl_options = {"REGISTER"}

    filename_ext = ".png"
    usual_name = "record.png"
    filter_glob: str = prop(StringProperty, default="*.png", options={"HIDDEN"})

    def run(self, context: bpy.types.Context) -> Messages:
        # OpenCV comes with the extension
        from ..pipeline.overlay.record_page import record_page

        scene, path = context.scene, self.chosen_file()
        check_outputs([path], input_files(scene))
        loaded = from_scene.loaded_case(scene).with_shown_structures()
        loaded = replace(loaded, case=replace(loaded.case, alignment=pose_record(scene)))
        picture = case_picture(loaded, text_mask).image
        write_bytes_atomically(path, encode_png(record_page(loaded, picture, text_mask)))
        return (f"saved {path}",)


register, unregister = class_registration(__name__)
