"""A CT dropped onto a 3D view opens."""

import bpy

from ..class_registration import class_registration
from .slice_areas import plane_of


class ONEFRAME_FH_ct(bpy.types.FileHandler):
    """Volumes, in any scene: nothing else in Blender opens them"""

    bl_idname = "ONEFRAME_FH_ct"
    bl_label = "OneFrame CT"
    bl_import_operator = "oneframe.open_ct"
    # of .nii.gz Blender looks at the last part
    bl_file_extensions = ".nii;.gz;.nrrd;.nhdr;.mha;.mhd"

    @classmethod
    def poll_drop(cls, context: bpy.types.Context | None) -> bool:
        """Called by Blender."""
        if context is None or context.area is None:
            return False
        return context.area.type == "VIEW_3D" or plane_of(context.space_data) is not None


register, unregister = class_registration((ONEFRAME_FH_ct,))
