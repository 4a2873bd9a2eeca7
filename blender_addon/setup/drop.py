"""Files dropped onto a 3D view: the operator of their kind opens them; where several could, Blender asks which.

Cases are in the menu File, Import too, which a small window shows and the sidebar's tab it may not.
"""

import bpy

from ..class_registration import listening
from ..state import from_scene, workbench
from ..video.operators import VIDEOS
from .operators import CAMERAS, IMAGES, MESHES

CASE = ".toml"


def extensions(glob: str) -> str:
    """``"*.png;*.toml"`` -> ``".png"``: a case is no other kind."""
    return ";".join(kind for kind in glob.replace("*", "").split(";") if kind != CASE)


class _Dropped(bpy.types.FileHandler):
    """Mixin: files dropped onto a 3D view, of the workbench only: elsewhere they are Blender's."""

    is_ours = False
    """Whether nothing else in Blender opens them, in any scene."""

    @classmethod
    def poll_drop(cls, context: bpy.types.Context | None) -> bool:
        if context is None or context.area is None or context.area.type != "VIEW_3D":
            return False
        return cls.is_ours or workbench.is_workbench(context.scene)


class ONEFRAME_FH_case(_Dropped):
    """Cases, in any scene"""

    bl_label = "OneFrame Case"
    bl_import_operator = "oneframe.open_case"
    bl_file_extensions = CASE
    is_ours = True


class ONEFRAME_FH_frame(_Dropped):
    """Frames"""

    bl_label = "OneFrame Frame"
    bl_import_operator = "oneframe.load_frame"
    bl_file_extensions = extensions(IMAGES)


class ONEFRAME_FH_camera(_Dropped):
    """Intrinsics"""

    bl_label = "OneFrame K"
    bl_import_operator = "oneframe.load_camera"
    bl_file_extensions = extensions(CAMERAS)


class ONEFRAME_FH_surface(_Dropped):
    """The surface"""

    bl_label = "OneFrame Surface"
    bl_import_operator = "oneframe.load_surface"
    bl_file_extensions = extensions(MESHES)


class ONEFRAME_FH_structures(_Dropped):
    """Structures in the surface"""

    bl_label = "OneFrame Structures"
    bl_import_operator = "oneframe.add_structure"
    bl_file_extensions = extensions(MESHES)

    @classmethod
    def poll_drop(cls, context: bpy.types.Context | None) -> bool:
        return super().poll_drop(context) and from_scene.present_surface(context.scene) is not None  # type: ignore[union-attr]  # polled


class ONEFRAME_FH_landmarks(_Dropped):
    """Landmarks"""

    bl_label = "OneFrame Landmarks"
    bl_import_operator = "oneframe.import_landmarks"
    bl_file_extensions = ".csv"


class ONEFRAME_FH_video(_Dropped):
    """Videos"""

    bl_label = "OneFrame Video"
    bl_import_operator = "oneframe.open_video"
    bl_file_extensions = extensions(VIDEOS)


class ONEFRAME_FH_ct(_Dropped):
    """Volumes, in any scene"""

    bl_label = "OneFrame CT"
    bl_import_operator = "oneframe.open_ct"
    # of .nii.gz Blender looks at the last part
    bl_file_extensions = ".nii;.gz;.nrrd"
    is_ours = True


def _draw_import(menu: bpy.types.Menu, context: bpy.types.Context) -> None:
    menu.layout.operator("oneframe.open_case", text="OneFrame Case (.toml)")


PARTS = (listening(bpy.types.TOPBAR_MT_file_import, _draw_import),)
