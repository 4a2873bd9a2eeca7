"""The tool in the toolbar with which the mouse drills; everything else stays Blender's."""

import bpy

from ..ui.keymap import DRILL_TOOL, TOOLS
from . import drill_session


class DrillTool(bpy.types.WorkSpaceTool):
    """Drill the bone of the CT with a spherical burr"""

    bl_space_type = "VIEW_3D"
    bl_context_mode = "OBJECT"
    bl_idname = DRILL_TOOL
    bl_label = TOOLS[DRILL_TOOL]
    bl_description = (
        "Drill the bone of the CT with a spherical burr, which stops at the margins of structures.\n"
        "Drag: remove bone. Ctrl + Wheel, [ and ]: diameter of the burr. Ctrl + Z: take back a stroke"
    )
    bl_icon = "ops.sculpt.mask_by_color"
    bl_cursor = "CROSSHAIR"
    bl_keymap = ()

    @staticmethod
    def draw_settings(context: bpy.types.Context, layout: bpy.types.UILayout, _tool: bpy.types.WorkSpaceTool) -> None:
        """Called by Blender."""
        if drill_session.of(context.scene) is None:
            layout.label(text="Press Drill in the panel CT first")
            return
        layout.prop(context.scene.oneframe_ct, "burr_mm")
        layout.label(text="Drag: Remove Bone    [ ]: Burr    Ctrl + Z: Undo Stroke")


def register() -> None:
    """Add the tool to the toolbar."""
    bpy.utils.register_tool(DrillTool, after={"oneframe.move_tool"})


def unregister() -> None:
    """Remove the tool and its keys."""
    bpy.utils.unregister_tool(DrillTool)
