"""Operators that load the frame, and say what becomes of the pose of another one."""

import bpy
from bpy.props import StringProperty

from ..class_registration import class_registration, prop
from ..pipeline.images.image_reader import read_image
from ..state import another_frame, from_scene, to_scene
from ..state.initial_pose import set_initial_pose
from ..ui.operator import Messages, OpensFile, Reporting, available

IMAGES = "*.png;*.jpg;*.jpeg;*.tif;*.tiff;*.bmp;*.exr"


class ONEFRAME_OT_load_frame(OpensFile):
    """Load the frame: one image of the microscope"""

    bl_label = "Load Frame"

    filter_glob: str = prop(StringProperty, default=IMAGES, options={"HIDDEN"})

    def run(self, context: bpy.types.Context) -> Messages:
        path = self.chosen_file()
        return to_scene.set_frame(context, path, read_image(path, path.name))


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
