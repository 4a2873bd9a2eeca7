"""The tool in the toolbar whose mouse buttons pick and drag landmarks; all else stays Blender's."""

import bpy

from ..pipeline.alignment.manual.picking import next_step
from ..state import from_scene
from ..ui.frame_view import shows_frame
from . import edit

TOOL = "oneframe.landmark_tool"

KEYS = (
    ("Click", "point in the frame"),
    ("Shift + click", "point on the surface"),
    ("Ctrl + drag", "pull the surface by a pin"),
    ("Drag a mark", "move it; Shift: 10 x finer"),
    ("Esc, right button", "put the drag back"),
    ("Alt + click a mark", "use it or not"),
    ("X, Delete on a mark", "delete it"),
)
"""What the tool's keys do in the camera view; in other 3D views a click picks on the surface."""


def _gesture(kind: str, **modifiers: bool) -> tuple:
    event = {"type": "LEFTMOUSE", "value": "PRESS", **modifiers}
    return "oneframe.landmark_gesture", event, {"properties": [("kind", kind)]}


def _at_pointer(operator: str, **event: object) -> tuple:
    return operator, event, {"properties": [("at_pointer", True)]}


class LandmarkTool(bpy.types.WorkSpaceTool):
    """Pick the same features in the frame and on the surface: the pose follows"""

    bl_space_type = "VIEW_3D"
    bl_context_mode = "OBJECT"
    bl_idname = TOOL
    bl_label = "Landmarks"
    bl_description = (
        "Pick the same features in the frame and on the surface; the pose follows.\n"
        "Click: point in the frame. Shift + click: point on the surface. Ctrl + drag: pull the surface by a pin"
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
        layout.label(text=step_sentence(context))


def step_sentence(context: bpy.types.Context) -> str:
    """What a click does next, for the tool's header and the pointer."""
    scene = context.scene
    if not from_scene.is_set_up(scene):
        return "Set up camera and surface first"
    landmarks = edit.landmarks_model(scene)
    return next_step(landmarks, scene.oneframe.landmark_index, in_frame=shows_frame(context))


def is_active(context: bpy.types.Context) -> bool:
    """Whether this tool is in hand."""
    tool = context.workspace.tools.from_space_view3d_mode("OBJECT", create=False)
    return context.mode == "OBJECT" and tool is not None and tool.idname == TOOL


def register() -> None:
    """Put the tool into the toolbar."""
    bpy.utils.register_tool(LandmarkTool, after={"builtin.measure"}, separator=True)


def unregister() -> None:
    """Take it out of the hand of whoever sees it, and out of the toolbar, its keys with it."""
    for window in bpy.context.window_manager.windows:
        tool = window.workspace.tools.from_space_view3d_mode("OBJECT", create=False)
        if tool is None or tool.idname != TOOL:
            continue
        for area in window.screen.areas:
            if area.type == "VIEW_3D":
                # by the operator: setting the tool itself needs a window in the context, and crashes without
                with bpy.context.temp_override(window=window, area=area):
                    bpy.ops.wm.tool_set_by_id(name="builtin.select_box")
                break
    bpy.utils.unregister_tool(LandmarkTool)
