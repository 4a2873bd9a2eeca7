"""The panel Move: nudges with their keys, and the current pose in both directions."""

import bpy

from ..pipeline.errors import InputError
from ..pipeline.transforms import inverse_rigid
from ..state.pose import cam_from_mesh_of
from ..ui.frame_view import shows_frame
from ..ui.keymap import binding
from ..ui.panel import AlignmentPanel, draw_text
from ..ui.step_panel import PartPanel, StepPanel
from .operators import STEPS

_PAIRS = (
    ("x", -1, "Left", "Right", "TRIA_LEFT", "TRIA_RIGHT"),
    ("y", -1, "Up", "Down", "TRIA_UP", "TRIA_DOWN"),
    ("depth", -1, "Nearer", "Farther", "ZOOM_IN", "ZOOM_OUT"),
    ("pitch", -1, "Tilt Up", "Tilt Down", "TRIA_UP_BAR", "TRIA_DOWN_BAR"),
    ("yaw", 1, "Turn Left", "Turn Right", "TRIA_LEFT_BAR", "TRIA_RIGHT_BAR"),
    ("roll", -1, "Roll Left", "Roll Right", "LOOP_BACK", "LOOP_FORWARDS"),
)
"""Axis, sign of the first button's step, labels and icons of the two buttons."""

_SHORT_NAMES = {
    "Left Arrow": "\N{LEFTWARDS ARROW}",
    "Right Arrow": "\N{RIGHTWARDS ARROW}",
    "Up Arrow": "\N{UPWARDS ARROW}",
    "Down Arrow": "\N{DOWNWARDS ARROW}",
}


class ONEFRAME_PT_pose(AlignmentPanel, StepPanel):
    """Move the surface in steps of image pixels; show the pose at full precision"""

    bl_label = "3  Move"
    bl_order = 4
    step = "move"

    def draw_step(self, context: bpy.types.Context, layout: bpy.types.UILayout) -> None:
        settings = context.scene.oneframe
        layout.operator_context = "EXEC_DEFAULT"
        row = layout.row(align=True)
        row.prop(settings, "step", expand=True)
        step_px = STEPS[settings.step]
        has_keys = shows_frame(context) and bool(binding("oneframe.nudge"))
        column = layout.column(align=True)
        for axis, first_sign, back, forth, back_icon, forth_icon in _PAIRS:
            row = column.row(align=True)
            for text, icon, sign in ((back, back_icon, first_sign), (forth, forth_icon, -first_sign)):
                nudge = row.operator("oneframe.nudge", text=text, icon=icon)
                nudge.axis, nudge.step_px = axis, sign * step_px
            keys = row.row(align=True)
            keys.enabled = False
            bindings = (binding("oneframe.nudge", axis=axis, step_px=sign * 1.0) for sign in (first_sign, -first_sign))
            keys.label(text="  ".join(_SHORT_NAMES.get(key, key) for key in bindings) if has_keys else "")
        row = column.row(align=True)
        for text, icon, anticlockwise in (("Roll -90°", "LOOP_BACK", True), ("Roll 90°", "LOOP_FORWARDS", False)):
            row.operator("oneframe.quarter_turn", text=text, icon=icon).anticlockwise = anticlockwise
        keys = row.row(align=True)
        keys.enabled = False
        first, second = (binding("oneframe.quarter_turn", anticlockwise=each) for each in (True, False))
        # their modifiers once: both would not fit
        keys.label(text=f"{first}  {second.split()[-1]}" if has_keys and second else "")
        if has_keys:
            layout.label(text="Alt: 10 px, Shift: 0.1 px, Hold: Repeat", icon="INFO")


class _Matrix(PartPanel):
    """Base of the two matrices, in the frame of the mesh file, read from the objects at every redraw."""

    bl_parent_id = "ONEFRAME_PT_pose"
    inverse = False

    def draw(self, context: bpy.types.Context) -> None:
        layout, scene = self.layout, context.scene
        try:
            pose = cam_from_mesh_of(scene)
        except InputError as error:
            draw_text(layout, str(error), icon="ERROR")
            return
        if self.inverse:
            pose = inverse_rigid(pose)
        rows = layout.column(align=True)
        rows.scale_y = 0.8
        for row in pose[:3, :3]:
            rows.label(text="  ".join(f"{value:.8f}" for value in row))
        rows.label(text="  ".join(f"{value:.6f}" for value in pose[:3, 3]) + f" {scene.oneframe.units}")
        row = layout.row(align=True)
        row.operator("oneframe.copy_pose", icon="COPYDOWN").inverse = self.inverse
        if not self.inverse:
            row.operator("oneframe.paste_pose", icon="PASTEDOWN")
            row.operator("oneframe.load_pose", text="", icon="FILE_FOLDER")


class ONEFRAME_PT_cam_from_mesh(_Matrix):
    """Pose of the surface in the camera's frame"""

    bl_label = "cam_from_mesh"
    bl_options = {"DEFAULT_CLOSED"}


class ONEFRAME_PT_mesh_from_cam(_Matrix):
    """Pose of the camera in the surface's frame"""

    bl_label = "mesh_from_cam (Inverse)"
    bl_options = {"DEFAULT_CLOSED"}
    inverse = True
