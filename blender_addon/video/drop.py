"""A video dropped onto a 3D view of the workbench opens; elsewhere it is Blender's."""

import bpy

from ..class_registration import class_registration
from ..state import workbench
from .operators import VIDEOS


class ONEFRAME_FH_video(bpy.types.FileHandler):
    """Videos"""

    bl_idname = "ONEFRAME_FH_video"
    bl_label = "OneFrame Video"
    bl_import_operator = "oneframe.open_video"
    bl_file_extensions = VIDEOS.replace("*", "")

    @classmethod
    def poll_drop(cls, context: bpy.types.Context | None) -> bool:
        """Called by Blender."""
        if context is None or context.area is None:
            return False
        return context.area.type == "VIEW_3D" and workbench.is_workbench(context.scene)


register, unregister = class_registration((ONEFRAME_FH_video,))
