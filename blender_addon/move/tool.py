"""The tool in the toolbar that moves the surface by plain drags; the handles and the keys work with it."""

import bpy

from ..ui.keymap import MOVE_TOOL, TOOLS


class MoveTool(bpy.types.WorkSpaceTool):
    """Move the surface in the frame by hand"""

    bl_space_type = "VIEW_3D"
    bl_context_mode = "OBJECT"
    bl_idname = MOVE_TOOL
    bl_label = TOOLS[MOVE_TOOL]
    bl_description = (
        "Move the surface in the frame by hand.\n"
        "Drag: shift. Ctrl + Drag: tilt and turn. Arrow keys: one pixel of the frame"
    )
    bl_icon = "ops.transform.translate"
    bl_cursor = "DEFAULT"
    bl_keymap = ()

    @staticmethod
    def draw_settings(_context: bpy.types.Context, layout: bpy.types.UILayout, _tool: bpy.types.WorkSpaceTool) -> None:
        layout.label(text="Drag: Shift    Ctrl + Drag: Tilt    Arrow Keys: 1 px of the Frame")


def register() -> None:
    """Add the tool to the toolbar."""
    bpy.utils.register_tool(MoveTool, after={"oneframe.landmark_tool"})


def unregister() -> None:
    """Remove the tool and its keys."""
    bpy.utils.unregister_tool(MoveTool)
