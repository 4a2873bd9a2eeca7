"""The panel Case: the case, what comes next, and what is doubtful; the steps of the work are in it."""

import bpy

from ..class_registration import class_registration
from ..pipeline.camera.plausibility import camera_doubts
from ..pipeline.errors import InputError
from ..state import from_scene, workbench
from ..state.to_scene import frame_warnings
from ..state.workbench import OPEN, next_step
from ..ui.panel import SidebarPanel, draw_text
from .alignment_record import doubts


class ONEFRAME_PT_case(SidebarPanel):
    """The case, and the steps of the work"""

    bl_label = "Case"

    def draw(self, context: bpy.types.Context) -> None:
        layout, settings = self.layout, context.scene.oneframe
        layout.operator_context = "INVOKE_DEFAULT"
        row = layout.row(align=True)
        row.operator("oneframe.open_case", icon="FILE_FOLDER")
        row.operator("oneframe.save_case", icon="FILE_TICK")
        row.operator("oneframe.save_case", text="", icon="DUPLICATE").save_as = True
        row.operator("oneframe.save_record", text="", icon="TEXT")
        if settings.case_path:
            layout.label(text=bpy.path.basename(settings.case_path), icon="FILE_TEXT")
        _draw_missing(layout, context.scene)


def _draw_missing(layout: bpy.types.UILayout, scene: bpy.types.Scene) -> None:
    step = next_step(scene)
    if step:
        draw_text(layout, step, icon="INFO")
    if scene.oneframe.aligned_path:
        row = layout.row(align=True)
        row.operator("oneframe.keep_pose", icon="PINNED")
        row.operator("oneframe.clear_pose", icon="X")
    if step == OPEN:
        if workbench.existing() not in (None, scene):
            layout.operator("oneframe.enter_workbench", icon="WORKSPACE")
        layout.operator("oneframe.open_sample", icon="HELP")
    for message in frame_warnings(scene):
        draw_text(layout, message, icon="ERROR")
        layout.operator("oneframe.rescale_camera", icon="FULLSCREEN_ENTER")
    if from_scene.present_camera(scene) is not None and not frame_warnings(scene):
        for message in camera_doubts(from_scene.camera(scene)):
            draw_text(layout, message, icon="QUESTION")
    if from_scene.is_set_up(scene):
        try:
            for message in doubts(scene):
                draw_text(layout, message, icon="ERROR")
        except InputError as error:
            draw_text(layout, str(error), icon="ERROR")
            layout.operator("oneframe.remove_scale", icon="CON_SIZELIMIT")


register, unregister = class_registration(__name__)
