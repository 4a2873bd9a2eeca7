"""The tool in the toolbar whose mouse buttons pick and drag landmarks; all else stays Blender's."""

import bpy

from . import gather, landmark_edit
from .frame_view import shows_frame
from .pipeline.alignment.landmark_picking import next_step

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

    def draw_settings(context, layout, _tool):  # Blender calls it without an instance
        layout.label(text=step_sentence(context))


def step_sentence(context: bpy.types.Context) -> str:
    """What a click does next, for the tool's header and the pointer."""
    scene = context.scene
    if not gather.is_set_up(scene):
        return "Set up camera and surface first"
    landmarks = landmark_edit.landmarks_model(scene)
    return next_step(landmarks, scene.oneframe.landmark_index, in_frame=shows_frame(context))


def is_active(context: bpy.types.Context) -> bool:
    """Whether this tool is in hand."""
    tool = context.workspace.tools.from_space_view3d_mode("OBJECT", create=False)
    return context.mode == "OBJECT" and tool is not None and tool.idname == TOOL


def register() -> None:
    """Put the tool into the toolbar."""
    bpy.utils.register_tool(LandmarkTool, after={"builtin.measure"}, separator=True)


def unregister() -> None:
    """Take it out, out of every hand, and its keys with it."""
    for workspace in bpy.data.workspaces:
        tool = workspace.tools.from_space_view3d_mode("OBJECT", create=False)
        if tool is not None and tool.idname == TOOL:
            tool.setup(idname="builtin.select_box", keymap="3D View Tool: Select Box")
    bpy.utils.unregister_tool(LandmarkTool)
    keyconfigs = bpy.context.window_manager.keyconfigs
    for keyconfig in (keyconfigs.addon, keyconfigs.default):
        if keyconfig is None:
            continue
        for keymap in [keymap for keymap in keyconfig.keymaps if keymap.name.endswith(f", {LandmarkTool.bl_label}")]:
            keyconfig.keymaps.remove(keymap)
