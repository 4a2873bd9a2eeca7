"""The tool that paints the mask on the frame. A stroke is one operator and one undo step; Esc takes it back."""

from dataclasses import replace

import bpy
import numpy as np
from bpy.props import BoolProperty, FloatProperty

from ..class_registration import prop, tool
from ..pipeline.camera.distortion import distorted_pixels
from ..pipeline.images.masked_frame import UNSEEN, painted
from ..state import another_frame, from_scene
from ..state.events import redraw
from ..ui.drag import Drag
from ..ui.frame_view import FrameView, shows_frame
from ..ui.keymap import MASK_TOOL, TOOLS, Key, ViewTool, active_tool, keys
from ..ui.operator import Messages, OperatorResult, Reporting
from ..ui.pane import Pane, PointerPane
from ..ui.strokes import Colour, Strokes
from .operators import frame_of, set_mask

HIDES: Colour = (*UNSEEN, 0.6)
SHOWS: Colour = (1.0, 1.0, 1.0, 0.4)
WHITE: Colour = (1.0, 1.0, 1.0, 1.0)

_strokes: list["ONEFRAME_OT_mask_stroke"] = []
"""The stroke under the hand, if there is one."""


class ONEFRAME_OT_mask_stroke(Drag, Reporting):
    """Drag: hide what shows no surface"""

    bl_label = "Paint the Mask"
    hint = "Esc or Right Click: Take Back the Stroke"

    shows: bool = prop(BoolProperty, "Show", "Show again what is hidden")

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return is_ready(context)

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> OperatorResult:
        self.way: list[np.ndarray] = []
        _strokes.append(self)
        return self.begin(context, event)

    def go(self, context: bpy.types.Context, event: bpy.types.Event) -> None:
        view = FrameView.of(context.scene, context.region, context.region_data)
        self.way.append(view.px_from_region([event.mouse_region_x + 0.5, event.mouse_region_y + 0.5]))
        redraw()

    def end(self, context: bpy.types.Context, *, undo: bool) -> OperatorResult:
        _strokes.clear()
        redraw()
        return {"CANCELLED"} if undo else self.execute(context)

    def run(self, context: bpy.types.Context) -> Messages:
        scene = context.scene
        way, lens, frame = np.array(self.way), from_scene.distortion(scene), frame_of(scene)
        if lens is not None:
            # the mask is that of the file, which the view shows without the lens's distortion
            way = distorted_pixels(from_scene.camera(scene), lens, way)
        shown = painted(frame.shown, way, scene.oneframe.mask_brush_px, shows=self.shows)
        return set_mask(scene, replace(frame, shown=shown))


class ONEFRAME_OT_mask_brush_size(bpy.types.Operator):
    """Change the radius of the brush"""

    bl_label = "Size of the Brush"
    bl_options = {"INTERNAL"}

    factor: float = prop(FloatProperty, "Factor", default=1.25)

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return is_ready(context)

    def execute(self, context: bpy.types.Context) -> OperatorResult:
        context.scene.oneframe.mask_brush_px *= self.factor
        return {"FINISHED"}


def is_ready(context: bpy.types.Context) -> bool:
    """Whether a drag paints: the tool is active in a view of the case's frame."""
    scene, in_frame = context.scene, active_tool(context) == MASK_TOOL and shows_frame(context)
    return in_frame and bool(scene.oneframe.frame_path) and another_frame.seen(scene) is None


class Brush(PointerPane):
    """The brush at the pointer."""

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return is_ready(context)

    @classmethod
    def draw(cls, context: bpy.types.Context, strokes: Strokes, pointer: tuple[int, int]) -> None:
        view = FrameView.of(context.scene, context.region, context.region_data)
        radius = context.scene.oneframe.mask_brush_px * view.magnification / strokes.unit
        strokes.circle(np.array(pointer) + 0.5, radius, WHITE, width=1.0)


class StrokeUnderHand(Pane):
    """The stroke that is being drawn."""

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return bool(_strokes) and shows_frame(context)

    @classmethod
    def draw(cls, context: bpy.types.Context, strokes: Strokes) -> None:
        view = FrameView.of(context.scene, context.region, context.region_data)
        way = view.region_from_px(np.array(_strokes[-1].way))
        # a click alone is a line too
        way = np.concatenate([way, way[-1:] + 0.1])
        width = 2 * context.scene.oneframe.mask_brush_px * view.magnification / strokes.unit
        strokes.line(way, SHOWS if _strokes[-1].shows else HIDES, width=width)


class MaskTool(ViewTool):
    """Paint over what shows no surface: instruments, hands, glare"""

    bl_idname = MASK_TOOL
    bl_label = TOOLS[MASK_TOOL]
    bl_description = (
        "Paint over what shows no surface, such as instruments, hands and glare.\n"
        "Drag: hide. Ctrl + Drag: show again. Ctrl + Wheel, [ and ]: size of the brush"
    )
    bl_icon = "ops.gpencil.draw.eraser"

    @staticmethod
    def draw_settings(context: bpy.types.Context, layout: bpy.types.UILayout, _tool: bpy.types.WorkSpaceTool) -> None:
        if not is_ready(context):
            layout.label(text="Look through the frame's camera (Numpad 0)")
            return
        layout.prop(context.scene.oneframe, "mask_brush_px")
        layout.label(text="Drag: Hide    Ctrl + Drag: Show Again    [ ]: Brush")


_TOOLS = (MASK_TOOL,)
_LARGER, _SMALLER = (("factor", 1.25),), (("factor", 0.8),)
_KEYS = keys(
    Key("oneframe.mask_stroke", "LEFTMOUSE", tools=_TOOLS),
    Key("oneframe.mask_stroke", "LEFTMOUSE", ctrl=True, properties=(("shows", True),), tools=_TOOLS),
    Key("oneframe.mask_brush_size", "WHEELUPMOUSE", ctrl=True, properties=_LARGER, tools=_TOOLS),
    Key("oneframe.mask_brush_size", "WHEELDOWNMOUSE", ctrl=True, properties=_SMALLER, tools=_TOOLS),
    Key("oneframe.mask_brush_size", "RIGHT_BRACKET", properties=_LARGER, tools=_TOOLS),
    Key("oneframe.mask_brush_size", "LEFT_BRACKET", properties=_SMALLER, tools=_TOOLS),
)
PARTS = (tool(MaskTool, "oneframe.move_tool"), _KEYS)
