"""The panel Case, in which the steps of the work are, and the step Set up: frame, K, surface and structures."""

from contextlib import suppress

import bpy

from ..pipeline.camera.plausibility import camera_doubts
from ..pipeline.case.surface_doubts import size_text
from ..pipeline.errors import InputError
from ..state import from_scene, to_scene
from ..state.properties import UNITS
from ..state.scene_files import recent
from ..state.to_scene import frame_warnings
from ..state.workbench import OPEN, next_step
from ..ui.panel import AdvancedPanel, AlignmentPanel, OpenPart, SidebarPanel, StepPanel, draw_text, is_folded
from . import history
from .alignment_record import doubts
from .operators import doubt_of_size


class ONEFRAME_PT_case(SidebarPanel):
    """The case, and the steps of the work"""

    bl_label = "Case"

    def draw(self, context: bpy.types.Context) -> None:
        layout, settings = self.layout, context.scene.oneframe
        layout.operator_context = "INVOKE_DEFAULT"
        if settings.case_path or from_scene.is_set_up(context.scene):
            row = layout.row()
            row.label(text=bpy.path.basename(settings.case_path) or "New case", icon="FILE_TEXT")
            # also in sight where a small window cuts the last step off
            row.operator("oneframe.save_case", text="", icon="FILE_TICK")
        _draw_missing(layout, context.scene)


def _draw_missing(layout: bpy.types.UILayout, scene: bpy.types.Scene) -> None:
    with suppress(InputError):
        if text := history.later_text(scene):
            draw_text(layout, text, icon="RECOVER_LAST")
            layout.operator("oneframe.restore", icon="LOOP_BACK").number = 0
    if history.is_changed_elsewhere(scene):
        draw_text(layout, "Another window or program has saved this case since: open it again.", icon="ERROR")
    step = next_step(scene)
    if step:
        draw_text(layout, step, icon="INFO")
    if step == OPEN:
        layout.operator("oneframe.open_sample", icon="HELP")
        for path in recent("cases"):
            name = f"{path.parent.name}/{path.name}"
            layout.operator("oneframe.open_case", text=name, icon="FILE_TEXT").filepath = str(path)
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
            size = doubt_of_size(scene, from_scene.surface_extents(scene))
            if size is not None and size.better_units is not None:
                titles = {name: title for name, title, _ in UNITS}
                text = f"Use {titles[size.better_units]}"
                layout.operator("oneframe.change_units", text=text, icon="ARROW_LEFTRIGHT").units = size.better_units
        except InputError as error:
            draw_text(layout, str(error), icon="ERROR")
            layout.operator("oneframe.remove_scale", icon="CON_SIZELIMIT")


class ONEFRAME_PT_history(AdvancedPanel):
    """The poses that the case had"""

    bl_label = "History"
    bl_order = 6

    def draw(self, context: bpy.types.Context) -> None:
        try:
            entries = history.listed(context.scene)
        except InputError as error:
            draw_text(self.layout, str(error), icon="ERROR")
            return
        column = self.layout.column(align=True)
        for number, entry in enumerate(entries):
            row = column.row(align=True)
            row.label(text=entry.text)
            row.operator("oneframe.restore", text="", icon="LOOP_BACK").number = number


class ONEFRAME_PT_setup(StepPanel):
    """Frame, camera and surface"""

    bl_label = "1  Open"
    bl_order = 1

    def draw(self, context: bpy.types.Context) -> None:
        layout = self.layout
        settings = context.scene.oneframe
        layout.operator_context = "INVOKE_DEFAULT"
        surface, is_set_up = from_scene.present_surface(context.scene), from_scene.is_set_up(context.scene)
        if is_set_up and settings.frame_path and surface is not None:
            names = f"{bpy.path.basename(settings.frame_path)}, {bpy.path.basename(surface.oneframe.mesh_path)}"
            icon = "DISCLOSURE_TRI_DOWN" if settings.show_files else "DISCLOSURE_TRI_RIGHT"
            layout.prop(settings, "show_files", text=names, icon=icon, emboss=False)
        if is_folded(context.scene):
            return
        layout.operator("oneframe.open_case", icon="FILE_FOLDER")
        column = layout.column(align=True)
        row = column.row(align=True)
        row.operator("oneframe.load_frame", icon="IMAGE_DATA")
        row.operator("oneframe.open_video", text="", icon="FILE_MOVIE")
        if settings.frame_path:
            column.label(text=bpy.path.basename(settings.frame_path))
        column.operator("oneframe.load_camera", icon="CAMERA_DATA")
        column.operator("oneframe.load_surface", icon="MESH_DATA")
        if surface is not None:
            row = column.row()
            row.label(text=bpy.path.basename(surface.oneframe.mesh_path) or surface.name)
            row.operator_menu_enum("oneframe.change_units", "units", text=settings.units)
            column.label(text=size_text(from_scene.surface_extents(context.scene)))
        column.operator("oneframe.add_structure", icon="OUTLINER_OB_MESH")
        column.operator("oneframe.load_pose", icon="EMPTY_ARROWS")


class ONEFRAME_PT_save(AlignmentPanel, StepPanel):
    """Save the case"""

    bl_label = "4  Save"
    bl_order = 4

    def draw(self, context: bpy.types.Context) -> None:
        self.layout.operator_context = "INVOKE_DEFAULT"
        row = self.layout.row(align=True)
        row.operator("oneframe.save_case", icon="FILE_TICK")
        row.operator("oneframe.save_case", text="", icon="DUPLICATE").save_as = True


class ONEFRAME_PT_camera(OpenPart):
    """K as loaded or typed"""

    bl_label = "Camera K (px)"
    bl_order = 1

    def draw(self, context: bpy.types.Context) -> None:
        layout, typed = self.layout, context.scene.oneframe.camera
        # no keyframes: K is not animated
        layout.use_property_split, layout.use_property_decorate = True, False
        if to_scene.frame_size(context.scene) is None:
            # else those of the frame
            column = layout.column(align=True)
            for name in ("width", "height"):
                column.prop(typed, name)
        column = layout.column(align=True)
        for name in ("fx", "fy", "cx", "cy"):
            column.prop(typed, name)
        layout.prop(typed, "pixel_origin")
        layout.prop(typed, "distortion")
        layout.operator("oneframe.set_camera", icon="CHECKMARK")


class ONEFRAME_PT_structures(OpenPart):
    """Structures in the bone, and their colours"""

    bl_label = "Structures"
    bl_order = 1

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        surface = context.scene.oneframe.surface
        return super().poll(context) and surface is not None and len(surface.children) > 0

    def draw(self, context: bpy.types.Context) -> None:
        surface = context.scene.oneframe.surface
        for child in () if surface is None else surface.children:
            if child.oneframe.role != "STRUCTURE":
                continue
            row = self.layout.row(align=True)
            row.prop(child, "color", text="")
            row.prop(child, "name", text="")
            row.prop(child, "show_in_front", text="", icon="XRAY")
            row.prop(child, "hide_viewport", text="", icon_only=True, emboss=False)
