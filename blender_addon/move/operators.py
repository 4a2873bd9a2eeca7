"""Operators that move the surface in steps of image pixels: by keys, and drags of the tool."""

import bpy
import numpy as np
from bpy.props import EnumProperty, FloatProperty

from ..class_registration import prop, tool
from ..pipeline.alignment.manual.nudge import Axis, nudged
from ..pipeline.errors import InputError
from ..state import frame_in_view, from_scene
from ..state.events import redraw
from ..state.pose import keep_pivot, pivot_of, set_cam_from_model
from ..ui.drag import Drag
from ..ui.frame_view import FrameView, shows_frame, window_region
from ..ui.keymap import MOVE_TOOL, TOOLS, Key, ViewTool, keys
from ..ui.operator import NeedsAlignment, OperatorResult, Reporting, report_error

AXES = [
    ("x", "Right", "Shift to the right in the image"),
    ("y", "Down", "Shift downwards in the image"),
    ("depth", "Farther", "Move away from the camera, along the view ray through the pivot"),
    ("pitch", "Pitch", "Rotate about the image's horizontal axis"),
    ("yaw", "Yaw", "Rotate about the image's vertical axis"),
    ("roll", "Roll", "Rotate clockwise about the view ray through the pivot"),
]
STEPS = {"fine": 0.1, "normal": 1.0, "coarse": 10.0}
"""Pixels of the frame."""

# of each axis: the key for the negative step, the key for the positive one
_KEY_PAIRS = {
    "x": ("LEFT_ARROW", "RIGHT_ARROW"),
    "y": ("UP_ARROW", "DOWN_ARROW"),
    "depth": ("M", "U"),
    "pitch": ("I", "K"),
    "yaw": ("L", "J"),
    "roll": ("COMMA", "PERIOD"),
}
_KEYBOARD = {key for pair in _KEY_PAIRS.values() for key in pair}


class _Mover(NeedsAlignment):
    """Mixin: moves the surface about the pivot, by keys or drags."""

    def _begin(self, context: bpy.types.Context) -> None:
        frame_in_view.check_own(context.scene)
        self._pivot, self._radius = pivot_of(context.scene)
        self._start_pose = from_scene.cam_from_model(context.scene)
        keep_pivot(context.scene, self._pivot, self._radius)

    def _moved(self, context: bpy.types.Context, pose: np.ndarray, axis: Axis, step_px: float) -> np.ndarray:
        return nudged(pose, from_scene.camera(context.scene), self._pivot, axis, step_px, self._radius)

    def _set_pose(self, context: bpy.types.Context, pose: np.ndarray) -> None:
        set_cam_from_model(context.scene, pose)
        redraw()


class ONEFRAME_OT_nudge(_Mover, Reporting):
    """Move the surface by a step in pixels of the frame; hold the key to repeat"""

    bl_label = "Nudge Surface"

    axis: Axis = prop(EnumProperty, "Axis", "Axis of the camera to move along or about", items=AXES)
    step_px: float = prop(
        FloatProperty,
        "Step",
        "Step in pixels of the frame; negative for the opposite direction",
        default=1.0,
        precision=2,
    )

    def run(self, context: bpy.types.Context) -> None:
        self._begin(context)
        self._set_pose(context, self._moved(context, self._start_pose, self.axis, self.step_px))

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> OperatorResult:
        # arrows go through the film while another frame is in view
        if event.type in _KEYBOARD and (not shows_frame(context) or frame_in_view.other(context.scene) is not None):
            return {"PASS_THROUGH"}
        result = self.execute(context)
        if result != {"FINISHED"} or event.value != "PRESS" or event.type in ("LEFTMOUSE", "RET"):
            return result
        # stay modal while the key is held: one undo step for all its repeats
        self._key = event.type
        context.window_manager.modal_handler_add(self)
        return {"RUNNING_MODAL"}

    def modal(self, context: bpy.types.Context, event: bpy.types.Event) -> OperatorResult:
        if event.type == self._key and event.value == "RELEASE":
            return {"FINISHED"}
        if event.type == self._key and event.value == "PRESS":
            pose = from_scene.cam_from_model(context.scene)
            self._set_pose(context, self._moved(context, pose, self.axis, self.step_px))
            return {"RUNNING_MODAL"}
        if event.type in ("MOUSEMOVE", "INBETWEEN_MOUSEMOVE", "NONE", "TIMER", "WINDOW_DEACTIVATE"):
            return {"FINISHED"} if event.type == "WINDOW_DEACTIVATE" else {"PASS_THROUGH"}
        # another key ends this gesture, and keeps its own effect
        return {"FINISHED", "PASS_THROUGH"}


class ONEFRAME_OT_drag_pose(_Mover, Drag):
    """Drag the surface with the mouse; Shift: 10 times finer, Esc or right click: cancel"""

    bl_label = "Drag Surface"
    bl_options = {"REGISTER", "UNDO", "BLOCKING", "GRAB_CURSOR"}

    mode: str = prop(
        EnumProperty,
        "Mode",
        items=[
            ("shift", "Shift", "Shift in the image plane"),
            ("tilt", "Tilt", "Rotate about the image's axes"),
            ("roll", "Roll", "Roll about the view ray"),
            ("depth", "Depth", "Up: farther, down: nearer"),
        ],
    )

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return super().poll(context) and shows_frame(context)

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> OperatorResult:
        try:
            self._begin(context)
        except InputError as error:
            report_error(self, str(error))
            return {"CANCELLED"}
        self._last, self._pose = self._pointer(context, event), self._start_pose
        return self.begin(context, event)

    def go(self, context: bpy.types.Context, event: bpy.types.Event) -> None:
        pointer = self._pointer(context, event)
        moved = (pointer - self._last) * (0.1 if event.shift else 1.0)
        for axis, step_px in self._steps(context, pointer, moved):
            self._pose = self._moved(context, self._pose, axis, step_px)
        self._last = pointer
        self._set_pose(context, self._pose)

    def end(self, context: bpy.types.Context, *, undo: bool) -> OperatorResult:
        if undo:
            self._set_pose(context, self._start_pose)
        return {"CANCELLED"} if undo else {"FINISHED"}

    def _steps(
        self, context: bpy.types.Context, pointer: np.ndarray, moved: np.ndarray
    ) -> tuple[tuple[Axis, float], ...]:
        if self.mode == "shift":
            return ("x", moved[0]), ("y", moved[1])
        if self.mode == "tilt":
            # points nearer than the pivot follow the pointer
            return ("yaw", -moved[0]), ("pitch", moved[1])
        if self.mode == "depth":
            return (("depth", -moved[1]),)
        camera = from_scene.camera(context.scene)
        pivot_cam = self._pose[:3, :3] @ self._pivot + self._pose[:3, 3]
        arm = pointer - camera.project(pivot_cam[None])[0]
        length = max(float(np.linalg.norm(arm)), 1.0)
        # the pointer's arc in pixels, converted to the radius at which a step of "roll" is measured
        arc = (arm[0] * moved[1] - arm[1] * moved[0]) / length
        return (("roll", arc / length * self._radius * camera.fx / pivot_cam[2]),)

    def _pointer(self, context: bpy.types.Context, event: bpy.types.Event) -> np.ndarray:
        region = window_region(context.area)
        view = FrameView.of(context.scene, region, context.area.spaces.active.region_3d)
        return view.px_from_region(np.array([event.mouse_x - region.x, event.mouse_y - region.y], float))


class MoveTool(ViewTool):
    """Move the surface in the frame by hand"""

    bl_idname = MOVE_TOOL
    bl_label = TOOLS[MOVE_TOOL]
    bl_description = (
        "Move the surface in the frame by hand.\n"
        "Drag: shift. Ctrl + Drag: tilt and turn. Alt + Drag: roll. Ctrl + Alt + Drag: depth. Arrow keys: one pixel"
    )
    bl_icon = "ops.transform.translate"
    bl_cursor = "DEFAULT"

    @staticmethod
    def draw_settings(context: bpy.types.Context, layout: bpy.types.UILayout, _tool: bpy.types.WorkSpaceTool) -> None:
        text = "Drag: Shift    Ctrl: Tilt    Alt: Roll    Ctrl + Alt: Depth    Arrow Keys: 1 px of the Frame"
        layout.label(text=text if shows_frame(context) else "Look through the frame's camera (Numpad 0)")


PARTS = (
    tool(MoveTool, "oneframe.landmark_tool"),
    keys(
        *(
            Key(
                "oneframe.nudge",
                key,
                shift=step == "fine",
                alt=step == "coarse",
                properties=(("axis", axis), ("step_px", sign * size)),
            )
            for axis, pair in _KEY_PAIRS.items()
            for key, sign in zip(pair, (-1, 1), strict=True)
            for step, size in STEPS.items()
        ),
        Key("oneframe.drag_pose", "LEFTMOUSE", properties=(("mode", "shift"),), tools=(MOVE_TOOL,)),
        Key("oneframe.drag_pose", "LEFTMOUSE", ctrl=True, properties=(("mode", "tilt"),), tools=(MOVE_TOOL,)),
        Key("oneframe.drag_pose", "LEFTMOUSE", alt=True, properties=(("mode", "roll"),), tools=(MOVE_TOOL,)),
        Key(
            "oneframe.drag_pose", "LEFTMOUSE", ctrl=True, alt=True, properties=(("mode", "depth"),), tools=(MOVE_TOOL,)
        ),
    ),
)
