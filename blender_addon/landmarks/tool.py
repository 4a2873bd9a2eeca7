"""The tool in the toolbar with which the mouse picks and drags landmarks; everything else stays Blender's."""

import bpy

from ..pipeline.alignment.manual.picking import next_step
from ..state import from_scene
from ..ui.frame_view import shows_frame

TOOL = "oneframe.landmark_tool"

KEYS = (
    ("Click", "Pick image point"),
    ("Shift + Click", "Pick surface point"),
    ("Ctrl + Drag", "Pull with a pin"),
    ("Drag Mark", "Move; Shift: finer"),
    ("Esc, Right Click", "Cancel the drag"),
    ("Alt + Click Mark", "Enable or disable"),
    ("X, Del on Mark", "Delete landmark"),
)
"""What mouse and keys do in the camera view; in other 3D views a click picks a surface point."""


def _gesture(kind: str, **modifiers: bool) -> tuple:
    event = {"type": "LEFTMOUSE", "value": "PRESS", **modifiers}
    return "oneframe.landmark_gesture", event, {"properties": [("kind", kind)]}


def _at_pointer(operator: str, **event: object) -> tuple:
    return operator, event, {"properties": [("at_pointer", True)]}


class LandmarkTool(bpy.types.WorkSpaceTool):
    """Pick the same features in the frame and on the surface; the pose follows"""

    bl_space_type = "VIEW_3D"
    bl_context_mode = "OBJECT"
    bl_idname = TOOL
    bl_label = "Landmarks"
    bl_description = (
        "Pick the same features in the frame and on the surface; the pose follows.\n"
        "Click: pick an image point. Shift + Click: pick a surface point. Ctrl + Drag: pull the surface with a pin"
    )
    bl_icon = "ops.paint.eyedropper_add"
    bl_cursor = "CROSSHAIR"
    bl_keymap = (
        _gesture("IMAGE"),
        _gesture("SURFACE", shift=True),
        _gesture("PIN", ctrl=True),
        _at_pointer("oneframe.landmark_toggle", type="LEFTMOUSE", value="PRESS", alt=True),
        _at_pointer("oneframe.landmark_remove", type="X", value="PRESS"),
        _at_pointer("oneframe.landmark_remove", type="DEL", value="PRESS"),
    )

    @staticmethod
    def draw_settings(context: bpy.types.Context, layout: bpy.types.UILayout, _tool: bpy.types.WorkSpaceTool) -> None:
        layout.label(text=instruction(context))


def instruction(context: bpy.types.Context) -> str:
    """The instruction for the next click, shown in the tool's header, in the panel and next to the pointer."""
    scene = context.scene
    if not from_scene.is_set_up(scene):
        return "Set up camera and surface first"
    landmarks = from_scene.landmarks_model(scene)
    return next_step(landmarks, scene.oneframe.landmark_index, in_frame=shows_frame(context))


def is_active(context: bpy.types.Context) -> bool:
    """Whether the landmark tool is the active one."""
    tool = context.workspace.tools.from_space_view3d_mode("OBJECT", create=False)
    return context.mode == "OBJECT" and tool is not None and tool.idname == TOOL


def register() -> None:
    """Add the tool to the toolbar."""
    bpy.utils.register_tool(LandmarkTool, after={"builtin.measure"}, separator=True)


def unregister() -> None:
    """Activate another tool wherever this one is active, then remove it and its keys from the toolbar."""
    for window in bpy.context.window_manager.windows:
        tool = window.workspace.tools.from_space_view3d_mode("OBJECT", create=False)
        if tool is None or tool.idname != TOOL:
            continue
        for area in window.screen.areas:
            if area.type == "VIEW_3D":
                # through the operator: without a window in the context, setting the tool itself crashes
                with bpy.context.temp_override(window=window, area=area):
                    bpy.ops.wm.tool_set_by_id(name="builtin.select_box")
                break
    bpy.utils.unregister_tool(LandmarkTool)
