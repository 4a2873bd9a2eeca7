"""Hides parts of the frame which show no surface, such as instruments, hands and glare: a guess, a file, and a brush.

A stroke of the brush is one operator and one undo step; Esc takes it back.
"""

from dataclasses import replace

import bpy
import numpy as np
from bpy.props import BoolProperty, StringProperty

from ..class_registration import prop, tool
from ..pipeline.camera.distortion import distorted_pixels
from ..pipeline.case.case_folder import KeptFile, keep_files
from ..pipeline.case.frame import Frame, read_frame
from ..pipeline.errors import InputError
from ..pipeline.images.masked_frame import UNSEEN, painted
from ..pipeline.images.pixel_values import to_uint8
from ..state import frame_in_view, from_scene, to_scene
from ..state.events import redraw
from ..state.scene_files import session_folder
from ..ui.drag import Drag
from ..ui.frame_view import FrameView, shows_frame
from ..ui.keymap import MASK_TOOL, TOOLS, Key, ViewTool, active_tool, keys
from ..ui.operator import Messages, OpensFile, OperatorResult, Reporting
from ..ui.pane import Pane, PointerPane
from ..ui.panel import OpenPart
from ..ui.strokes import Colour, Strokes

FILES = "*.png"
_SUFFIX = "_masked"


def frame_of(scene: bpy.types.Scene) -> Frame:
    """The scene's frame with its mask."""
    return read_frame(from_scene.absolute_path(scene.oneframe.frame_path))


def set_mask(scene: bpy.types.Scene, frame: Frame) -> Messages:
    """Use the frame with another mask, as a file of this session."""
    settings = scene.oneframe
    is_from_film = settings.frame_path == scene.oneframe_video.taken_path
    path = session_folder() / f"{frame.path.stem.removesuffix(_SUFFIX)}{_SUFFIX}.png"
    keep_files([KeptFile(path, frame.encoded())], {})
    to_scene.relink_frame(scene, path)
    if is_from_film:
        scene.oneframe_video.taken_path = settings.frame_path
    return (f"{frame.masked:.1%} of the frame masked",)


class _OfTheFrame(Reporting):
    """Mixin: available once there is a frame."""

    needs = (lambda context: context.scene.oneframe.frame_path, "Load the frame first")


class ONEFRAME_OT_load_mask(_OfTheFrame, OpensFile):
    """Hide parts of the frame that show no surface: an image of its size, grey or with alpha, in which they are 0"""

    bl_label = "Load Mask"

    filter_glob: str = prop(StringProperty, default=FILES, options={"HIDDEN"})

    def run(self, context: bpy.types.Context) -> Messages:
        return set_mask(context.scene, frame_of(context.scene).with_mask(self.chosen_file()))


class ONEFRAME_OT_guess_mask(_OfTheFrame):
    """Hide what is overexposed, as cold in colour as metal and gloves, or outside a round view; then correct it"""

    bl_label = "Guess"

    def run(self, context: bpy.types.Context) -> Messages:
        # OpenCV comes with the extension
        from ..pipeline.video.frame_mask import single_mask

        frame = frame_of(context.scene)
        shown = single_mask(to_uint8(frame.colours))
        if not shown.any():
            raise InputError("expected a frame that shows tissue, found none by its colours; paint the mask instead")
        return set_mask(context.scene, replace(frame, shown=frame.shown & shown))


class ONEFRAME_OT_clear_mask(_OfTheFrame):
    """Hide nothing of the frame any more"""

    bl_label = "Clear"

    def run(self, context: bpy.types.Context) -> Messages:
        frame = frame_of(context.scene)
        return set_mask(context.scene, replace(frame, shown=np.ones_like(frame.shown)))


class ONEFRAME_PT_mask(OpenPart):
    """What of the frame shows no surface"""

    bl_label = "Mask"
    bl_order = 1

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return super().poll(context) and bool(context.scene.oneframe.frame_path)

    def draw(self, context: bpy.types.Context) -> None:
        layout = self.layout
        layout.operator_context = "INVOKE_DEFAULT"
        row = layout.row(align=True)
        row.operator("wm.tool_set_by_id", text="Paint", icon="BRUSH_DATA").name = MASK_TOOL
        row.prop(context.scene.oneframe, "mask_brush_px")
        row = layout.row(align=True)
        row.operator("oneframe.guess_mask", icon="SHADERFX")
        row.operator("oneframe.load_mask", text="Load", icon="FILE_FOLDER")
        row.operator("oneframe.clear_mask", icon="X")


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


def is_ready(context: bpy.types.Context) -> bool:
    """Whether a drag paints: the tool is active in a view of the case's frame."""
    scene, in_frame = context.scene, active_tool(context) == MASK_TOOL and shows_frame(context)
    return in_frame and bool(scene.oneframe.frame_path) and frame_in_view.other(scene) is None


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
_SIZE = "data_path", "scene.oneframe.mask_brush_px"
_LARGER, _SMALLER = (_SIZE, ("value", 1.25)), (_SIZE, ("value", 0.8))
_KEYS = keys(
    Key("oneframe.mask_stroke", "LEFTMOUSE", tools=_TOOLS),
    Key("oneframe.mask_stroke", "LEFTMOUSE", ctrl=True, properties=(("shows", True),), tools=_TOOLS),
    Key("wm.context_scale_float", "WHEELUPMOUSE", ctrl=True, properties=_LARGER, tools=_TOOLS),
    Key("wm.context_scale_float", "WHEELDOWNMOUSE", ctrl=True, properties=_SMALLER, tools=_TOOLS),
    Key("wm.context_scale_float", "RIGHT_BRACKET", properties=_LARGER, tools=_TOOLS),
    Key("wm.context_scale_float", "LEFT_BRACKET", properties=_SMALLER, tools=_TOOLS),
)


PARTS = (
    tool(MaskTool, "oneframe.move_tool"),
    _KEYS,
)
