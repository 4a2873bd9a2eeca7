"""Operators that load the frame and join a mask to it: what it hides shows no surface."""

from pathlib import Path

import bpy
from bpy.props import StringProperty

from ..class_registration import class_registration, prop
from ..pipeline.blender.bridge.image import read_image
from ..pipeline.blender.case.frame_file import read_frame
from ..pipeline.case.case_folder import keep_files
from ..state import another_frame, from_scene, to_scene
from ..state.initial_pose import set_initial_pose
from ..state.scene_files import session_folder
from ..ui.operator import Messages, OpensFile, Reporting, available

IMAGES = "*.png;*.jpg;*.jpeg;*.tif;*.tiff;*.bmp;*.exr"
MASKS = "*.png;*.tif;*.tiff;*.bmp"
_SUFFIX = "_masked"


class ONEFRAME_OT_load_frame(OpensFile):
    """Load the frame: one image of the microscope"""

    bl_label = "Load Frame"

    filter_glob: str = prop(StringProperty, default=IMAGES, options={"HIDDEN"})

    def run(self, context: bpy.types.Context) -> Messages:
        path = self.chosen_file()
        return to_scene.set_frame(context, path, read_image(path, path.name))


class ONEFRAME_OT_load_mask(OpensFile):
    """Hide parts of the frame that show no surface: an image of its size, grey or with alpha, in which they are 0"""

    bl_label = "Load Mask"

    filter_glob: str = prop(StringProperty, default=MASKS, options={"HIDDEN"})

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return available(cls, bool(context.scene.oneframe.frame_path), "Load the frame first")

    def run(self, context: bpy.types.Context) -> Messages:
        path = from_scene.absolute_path(context.scene.oneframe.frame_path)
        frame = read_frame(path).with_mask(self.chosen_file())
        kept = frame.kept(session_folder() / f"{Path(path).stem.removesuffix(_SUFFIX)}{_SUFFIX}.png")
        keep_files([kept], {})
        to_scene.relink_frame(context.scene, kept.path)
        return (f"{frame.masked:.1%} of the frame masked; Load Frame again takes the mask off",)


class _OfAnotherFrame(Reporting):
    """Mixin: available while pose and image points are those of another frame."""

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return available(cls, bool(context.scene.oneframe.aligned_path), "The pose is of this frame")


class ONEFRAME_OT_keep_pose(_OfAnotherFrame):
    """Start from the pose of the other frame, recorded as such; landmarks keep their surface points only"""

    bl_label = "Keep Pose"

    def run(self, context: bpy.types.Context) -> None:
        another_frame.keep_pose(context.scene)


class ONEFRAME_OT_clear_pose(_OfAnotherFrame):
    """Start from an initial guess, without landmarks"""

    bl_label = "Clear"

    def run(self, context: bpy.types.Context) -> None:
        scene = context.scene
        set_initial_pose(scene, from_scene.surface_of(scene))
        to_scene.replace_landmarks(scene, ())
        scene.oneframe.aligned_path = ""


register, unregister = class_registration(__name__)
