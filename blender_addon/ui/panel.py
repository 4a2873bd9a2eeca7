"""Base classes of the panels in the sidebar, and long texts in them."""

import textwrap

import bpy

from ..state import from_scene

CHARACTER_PX = 6.5
"""Mean width of a character in the interface font at scale 1."""


class SidebarPanel(bpy.types.Panel):
    """Mixin: in the add-on's tab of the sidebar."""

    bl_space_type = "VIEW_3D"
    bl_region_type = "UI"
    bl_category = "OneFrame"


class StepPanel(SidebarPanel):
    """Mixin: a step of the work, in sight."""

    bl_parent_id = "ONEFRAME_PT_case"


class AdvancedPanel(SidebarPanel):
    """Mixin: what not every case needs."""

    bl_parent_id = "ONEFRAME_PT_advanced"
    bl_options = {"DEFAULT_CLOSED"}


class ONEFRAME_PT_advanced(SidebarPanel):
    """CT, view, other frames, colour, dataset"""

    bl_label = "Advanced"
    bl_order = 1
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context: bpy.types.Context) -> None:
        """Called by Blender; its parts draw themselves."""


class AlignmentPanel(SidebarPanel):
    """Mixin: there once camera and surface are set up."""

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return from_scene.is_set_up(context.scene)


def is_folded(scene: bpy.types.Scene) -> bool:
    """Whether all that a case needs is loaded, and what loads it is out of the way of the other steps."""
    return bool(scene.oneframe.frame_path) and from_scene.is_set_up(scene) and not scene.oneframe.show_files


class OpenPart(SidebarPanel):
    """Mixin: a part of the step Open."""

    bl_parent_id = "ONEFRAME_PT_setup"
    bl_options = {"DEFAULT_CLOSED"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return not is_folded(context.scene)


def draw_text(layout: bpy.types.UILayout, text: str, *, icon: str = "NONE", lines: int = 1) -> None:
    """Draw a text of any length as labels, wrapped to the width of the sidebar; it is at least ``lines`` high."""
    region = bpy.context.region
    scale = bpy.context.preferences.system.ui_scale
    width = 230 if region is None else region.width / scale
    texts = textwrap.wrap(text, max(20, int((width - 50) / CHARACTER_PX)))
    column = layout.column(align=True)
    column.scale_y = 0.75
    for number, line in enumerate((*texts, *[""] * (lines - len(texts)))):
        column.label(text=line, icon=icon if number == 0 and texts else "BLANK1" if icon != "NONE" else "NONE")
