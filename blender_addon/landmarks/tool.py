"""The tools in the toolbar with which the mouse pulls pins and picks landmarks; everything else stays Blender's."""

import bpy

from ..class_registration import at_end, tool
from ..pipeline.alignment.manual.picking import next_step
from ..state import frame_in_view
from ..state.landmarks import landmarks_model
from ..state.workbench import next_step as missing_step
from ..ui.frame_view import shows_frame
from ..ui.keymap import LANDMARK_TOOL, PIN_TOOL, TOOLS, ViewTool, active_tool

GESTURE = "ONEFRAME_OT_landmark_gesture"
"""Name, in Blender, of the operator with which the mouse picks and pulls."""


class _AsksForPoints(ViewTool):
    @staticmethod
    def draw_settings(context: bpy.types.Context, layout: bpy.types.UILayout, _tool: bpy.types.WorkSpaceTool) -> None:
        pin = "    Ctrl + Drag: Pin" if active_tool(context) == LANDMARK_TOOL and shows_frame(context) else ""
        layout.label(text=instruction(context) + pin)


class PinTool(_AsksForPoints):
    """Drag points of the surface to where the frame shows them; the surface follows"""

    bl_idname = PIN_TOOL
    bl_label = TOOLS[PIN_TOOL]
    bl_description = (
        "Drag a point of the surface to where the frame shows it; the surface follows, and earlier pins hold it.\n"
        "Drag a pin again to correct it. Alt + Click: enable or disable. X: delete"
    )
    bl_icon = "ops.curve.pen"


class LandmarkTool(_AsksForPoints):
    """Pick the same features in the frame and on the surface; the pose follows"""

    bl_idname = LANDMARK_TOOL
    bl_label = TOOLS[LANDMARK_TOOL]
    bl_description = (
        "Pick the same features in the frame and on the surface; the pose follows.\n"
        "Click: pick an image point. Shift + Click: pick a surface point. Ctrl + Drag: pull the surface with a pin"
    )
    bl_icon = "ops.paint.eyedropper_add"


def instruction(context: bpy.types.Context) -> str:
    """The instruction for the next click, shown in the tool's header, in the panel and next to the pointer."""
    scene = context.scene
    missing = missing_step(scene)
    if missing:
        return missing
    if frame_in_view.other(scene) is not None:
        return "Another frame is in view; Esc: back to the case's frame"
    landmarks = landmarks_model(scene)
    in_frame = shows_frame(context)
    if active_tool(context) == PIN_TOOL and in_frame:
        return "Drag a point of the surface to where the frame shows it"
    return next_step(landmarks, scene.oneframe.landmark_index, in_frame=in_frame)


def is_waiting(context: bpy.types.Context) -> bool:
    """Whether a click picks or pulls: not while something else has the mouse, or another frame is in view."""
    running = () if context.window is None else context.window.modal_operators
    if frame_in_view.other(context.scene) is not None:
        return False
    return active_tool(context) in (PIN_TOOL, LANDMARK_TOOL) and not any(
        operator.bl_idname.startswith("ONEFRAME_OT_") and operator.bl_idname != GESTURE for operator in running
    )


def leave_tools() -> None:
    """Activate another tool wherever one of the add-on's is active."""
    for window in bpy.context.window_manager.windows:
        active = window.workspace.tools.from_space_view3d_mode("OBJECT", create=False)
        if active is None or active.idname not in TOOLS:
            continue
        for area in window.screen.areas:
            if area.type == "VIEW_3D":
                # through the operator: without a window in the context, setting the tool itself crashes
                with bpy.context.temp_override(window=window, area=area):
                    bpy.ops.wm.tool_set_by_id(name="builtin.select_box")
                break


PARTS = (tool(PinTool, "builtin.select_box", separator=True), tool(LandmarkTool, PIN_TOOL), at_end(leave_tools))
