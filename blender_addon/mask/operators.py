"""Operators that hide parts of the frame which show no surface, such as instruments, hands and glare."""

from dataclasses import replace

import bpy
import numpy as np
from bpy.props import StringProperty

from ..class_registration import prop
from ..pipeline.case.case_folder import KeptFile, keep_files
from ..pipeline.case.frame import Frame, read_frame
from ..pipeline.errors import InputError
from ..pipeline.images.pixel_values import to_uint8
from ..state import from_scene, to_scene
from ..state.scene_files import session_folder
from ..ui.keymap import MASK_TOOL
from ..ui.operator import Messages, OpensFile, Reporting
from ..ui.panel import SidebarPanel

FILES = "*.png;*.tif;*.tiff"
_SUFFIX = "_masked"


def frame_of(scene: bpy.types.Scene) -> Frame:
    """The scene's frame with its mask."""
    return read_frame(from_scene.absolute_path(scene.oneframe.frame_path))


def set_mask(scene: bpy.types.Scene, frame: Frame) -> Messages:
    """Use the frame with another mask, as a file of this session."""
    settings = scene.oneframe
    is_from_film = settings.frame_path == scene.oneframe_video.taken_path
    path = session_folder() / f"{frame.path.stem.removesuffix(_SUFFIX)}{_SUFFIX}.png"
    keep_files([KeptFile(path, frame.encoded())], {})
    to_scene.relink_frame(scene, path)
    if is_from_film:
        scene.oneframe_video.taken_path = settings.frame_path
    return (f"{frame.masked:.1%} of the frame masked",)


class _OfTheFrame(Reporting):
    """Mixin: available once there is a frame."""

    needs = (lambda context: context.scene.oneframe.frame_path, "Load the frame first")


class ONEFRAME_OT_load_mask(_OfTheFrame, OpensFile):
    """Hide parts of the frame that show no surface: an image of its size, grey or with alpha, in which they are 0"""

    bl_label = "Load Mask"

    filter_glob: str = prop(StringProperty, default=FILES, options={"HIDDEN"})

    def run(self, context: bpy.types.Context) -> Messages:
        return set_mask(context.scene, frame_of(context.scene).with_mask(self.chosen_file()))


class ONEFRAME_OT_guess_mask(_OfTheFrame):
    """Hide what is overexposed, as cold in colour as metal and gloves, or outside a round view; then correct it"""

    bl_label = "Guess"

    def run(self, context: bpy.types.Context) -> Messages:
        # OpenCV comes with the extension
        from ..pipeline.video.frame_mask import single_mask

        frame = frame_of(context.scene)
        shown = single_mask(to_uint8(frame.colours))
        if not shown.any():
            raise InputError("expected a frame that shows tissue, found none by its colours; paint the mask instead")
        return set_mask(context.scene, replace(frame, shown=frame.shown & shown))


class ONEFRAME_OT_clear_mask(_OfTheFrame):
    """Hide nothing of the frame any more"""

    bl_label = "Clear"

    def run(self, context: bpy.types.Context) -> Messages:
        frame = frame_of(context.scene)
        return set_mask(context.scene, replace(frame, shown=np.ones_like(frame.shown)))


class ONEFRAME_PT_mask(SidebarPanel):
    """What of the frame shows no surface"""

    bl_parent_id = "ONEFRAME_PT_setup"
    bl_label = "Mask"
    bl_order = 1
    bl_options = {"DEFAULT_CLOSED"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return bool(context.scene.oneframe.frame_path)

    def draw(self, context: bpy.types.Context) -> None:
        layout = self.layout
        layout.operator_context = "INVOKE_DEFAULT"
        row = layout.row(align=True)
        row.operator("wm.tool_set_by_id", text="Paint", icon="BRUSH_DATA").name = MASK_TOOL
        row.prop(context.scene.oneframe, "mask_brush_px")
        row = layout.row(align=True)
        row.operator("oneframe.guess_mask", icon="SHADERFX")
        row.operator("oneframe.load_mask", text="Load", icon="FILE_FOLDER")
        row.operator("oneframe.clear_mask", icon="X")
