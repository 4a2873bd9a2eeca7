"""Mouse and wheel in the slices: a drag moves the point, the wheel leafs, a drag with the right button sets the window.

Everything else, such as panning with the middle button, stays that of Blender's Image Editor.
"""

import bpy
import numpy as np
from bpy.props import EnumProperty, IntProperty

from ..class_registration import prop
from ..ui.drag import Drag
from ..ui.keymap import Key, Place, keys
from ..ui.operator import OperatorResult
from .slice_areas import SliceView, inside

HU_PER_PX = 6.0
"""Of a drag with the right button, at interface scale 1."""


class _InSlice(bpy.types.Operator):
    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return SliceView.of(context) is not None


class ONEFRAME_OT_slice_step(_InSlice):
    """Leaf through the slices; with Ctrl, zoom"""

    bl_label = "Next Slice"
    bl_options = {"INTERNAL"}

    step: int = prop(IntProperty, "Step", default=1)
    zoom: str = prop(EnumProperty, "Zoom", items=[("NONE", "No", ""), ("IN", "In", ""), ("OUT", "Out", "")])

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> OperatorResult:
        view = SliceView.of(context)
        if view is None:
            return {"PASS_THROUGH"}
        if self.zoom != "NONE":
            zoomed = bpy.ops.image.view_zoom_in if self.zoom == "IN" else bpy.ops.image.view_zoom_out
            zoomed("INVOKE_DEFAULT")
            return {"FINISHED"}
        settings = context.scene.oneframe_ct
        _, u, v = view.plane.place_of(np.array(settings.cursor_mm))
        number = float(np.clip(view.number + self.step, 0, view.plane.count - 1))
        settings.cursor_mm = view.plane.point_at(number, u, v).tolist()
        return {"FINISHED"}


class ONEFRAME_OT_slice_point(_InSlice, Drag):
    """Drag: the other slices follow to the point under the pointer"""

    bl_label = "Go to Point"
    bl_options = {"INTERNAL", "BLOCKING"}

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> OperatorResult:
        return self.begin(context, event)

    def go(self, context: bpy.types.Context, event: bpy.types.Event) -> None:
        view = SliceView.of(context)
        if view is None:
            return
        u, v = view.px_from_region(np.array([event.mouse_region_x + 0.5, event.mouse_region_y + 0.5]))
        settings = context.scene.oneframe_ct
        number, _, _ = view.plane.place_of(np.array(settings.cursor_mm))
        settings.cursor_mm = inside(view.ct, view.plane.point_at(number, float(u), float(v))).tolist()

    def end(self, context: bpy.types.Context, *, undo: bool) -> OperatorResult:
        return {"FINISHED"}


class ONEFRAME_OT_slice_window(_InSlice, Drag):
    """Drag: right for a wider window, up for a higher level of HU"""

    bl_label = "Window and Level"
    bl_options = {"INTERNAL", "BLOCKING"}
    button = "RIGHTMOUSE"

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> OperatorResult:
        settings = context.scene.oneframe_ct
        self._start = np.array([event.mouse_x, event.mouse_y], float)
        self._before = settings.width_hu, settings.level_hu
        return self.begin(context, event)

    def go(self, context: bpy.types.Context, event: bpy.types.Event) -> None:
        settings = context.scene.oneframe_ct
        moved = np.array([event.mouse_x, event.mouse_y]) - self._start
        across, up = moved * HU_PER_PX / context.preferences.system.ui_scale
        width, level = self._before
        settings.width_hu, settings.level_hu = max(1.0, width + across), level + up

    def end(self, context: bpy.types.Context, *, undo: bool) -> OperatorResult:
        if undo:
            settings = context.scene.oneframe_ct
            settings.width_hu, settings.level_hu = self._before
        return {"CANCELLED"} if undo else {"FINISHED"}


# tools come before the editor's own keys: a click would pick a colour
_PLACES = (Place("Image", "IMAGE_EDITOR"), Place("Image Editor Tool: Sample", "IMAGE_EDITOR", is_tool=True))


def _key(operator: str, kind: str, *, ctrl: bool = False, **settings: object) -> Key:
    return Key(operator, kind, ctrl=ctrl, properties=tuple(settings.items()), tools=(), places=_PLACES)


_KEYS = keys(
    _key("oneframe.slice_step", "WHEELUPMOUSE", step=1),
    _key("oneframe.slice_step", "WHEELDOWNMOUSE", step=-1),
    _key("oneframe.slice_step", "PAGE_UP", step=1),
    _key("oneframe.slice_step", "PAGE_DOWN", step=-1),
    _key("oneframe.slice_step", "WHEELUPMOUSE", ctrl=True, zoom="IN"),
    _key("oneframe.slice_step", "WHEELDOWNMOUSE", ctrl=True, zoom="OUT"),
    _key("oneframe.slice_point", "LEFTMOUSE"),
    _key("oneframe.slice_window", "RIGHTMOUSE"),
)
PARTS = (_KEYS,)
