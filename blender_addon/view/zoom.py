"""Zooms the camera view about the pointer, or fits the whole frame into what no toolbar, sidebar or header covers.

Zoom and pan belong to the view: nothing here moves an object.
"""

import bpy
import numpy as np
from bpy.props import BoolProperty, FloatProperty

from ..class_registration import prop, start_timer
from ..state import from_scene
from ..state.events import areas
from ..ui.frame_view import FrameView, shows_frame, window_region
from ..ui.operator import NeedsAlignment, OperatorResult

MAGNIFICATIONS = (1 / 16, 64.0)
"""Smallest and largest zoom in region pixels per frame pixel."""

MARGIN_PX = 8
"""Between the frame and what surrounds it, at interface scale 1."""

STATUS_PX = 20.0
"""Height of a line of the status on top of a view, at interface scale 1."""

DRAWN_S = 0.05
"""Time after which a view has been drawn once; before that its regions have no sizes."""

_waiting: set[int] = set()


class FrameTool(NeedsAlignment):
    """Mixin: available in 3D views that look through the frame's camera."""

    needs = (shows_frame, "Look through the frame's camera first")


class ONEFRAME_OT_zoom_frame(FrameTool):
    """Zoom the camera view about the pointer; the pose stays"""

    bl_label = "Zoom Frame"
    bl_options = {"REGISTER"}

    factor: float = prop(FloatProperty, "Factor", "Change of the zoom", default=1.25, min=0.01, max=100)
    to_pixels: bool = prop(BoolProperty, "1 : 1", "A pixel of the screen for each of the frame, whatever the factor")

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> OperatorResult:
        # Blender's own zooms to the middle, unless a preference says otherwise
        region = window_region(context.area)
        at = np.array([event.mouse_x - region.x, event.mouse_y - region.y], float)
        return self._zoom(context, at)

    def execute(self, context: bpy.types.Context) -> OperatorResult:
        region = window_region(context.area)
        return self._zoom(context, np.array([region.width, region.height]) / 2)

    def _zoom(self, context: bpy.types.Context, at: np.ndarray) -> OperatorResult:
        now = FrameView.of(context.scene, window_region(context.area), context.space_data.region_3d).magnification
        zoom_view(context.scene, context.area, at, at, 1 / now if self.to_pixels else self.factor)
        return {"FINISHED"}


def zoom_view(scene: bpy.types.Scene, area: bpy.types.Area, pointer: np.ndarray, to: np.ndarray, factor: float) -> None:
    """Zoom a camera view by a factor; what is at ``pointer``, px of the region, comes ``to`` another place."""
    region, region_3d = window_region(area), area.spaces.active.region_3d
    before = FrameView.of(scene, region, region_3d)
    pixel = before.px_from_region(pointer)
    clipped = float(np.clip(factor * before.magnification, *MAGNIFICATIONS))
    zoom = _zoom_factor(region_3d.view_camera_zoom) * clipped / before.magnification
    region_3d.view_camera_zoom = float(np.clip(50 * (2 * np.sqrt(zoom) - np.sqrt(2)), -30, 600))
    region_3d.update()
    shift = FrameView.of(scene, region, region_3d).region_from_px(pixel) - to
    # Blender's camera offset is in half widths of the region, at zoom factor 1
    half_widths = shift / (2 * _zoom_factor(region_3d.view_camera_zoom) * np.array([region.width, region.height]))
    region_3d.view_camera_offset = np.array(region_3d.view_camera_offset) + half_widths
    region_3d.update()
    area.tag_redraw()


def _zoom_factor(view_camera_zoom: float) -> float:
    """Convert Blender's ``view_camera_zoom`` to a factor."""
    return (np.sqrt(2) + view_camera_zoom / 50) ** 2 / 4


def free_rectangle(area: bpy.types.Area) -> tuple[np.ndarray, np.ndarray]:
    """Lower left and upper right corner (px of the view's region) of what is left of a 3D view for the frame."""
    low, high = uncovered_rectangle(area)
    high = high - [0.0, STATUS_PX * bpy.context.preferences.system.ui_scale]
    return (low, high) if (high > low).all() else uncovered_rectangle(area)


def uncovered_rectangle(area: bpy.types.Area) -> tuple[np.ndarray, np.ndarray]:
    """Lower left and upper right corner (px of the view's region) of what other regions leave of a 3D view."""
    region = window_region(area)
    low, high = np.array([0.0, 0.0]), np.array([region.width, region.height], float)
    for other in area.regions:
        if other == region or min(other.width, other.height) <= 1 or other.type == "HUD":
            continue
        x, y = other.x - region.x, other.y - region.y
        if x + other.width <= 0 or y + other.height <= 0 or x >= region.width or y >= region.height:
            # beside the view, not over it
            continue
        match other.alignment:
            case "LEFT":
                low[0] = max(low[0], x + other.width)
            case "RIGHT":
                high[0] = min(high[0], x)
            case "TOP":
                high[1] = min(high[1], y)
            case "BOTTOM":
                low[1] = max(low[1], y + other.height)
    return (low, high) if (high > low).all() else (np.zeros(2), np.array([region.width, region.height], float))


def fit_frame(scene: bpy.types.Scene, area: bpy.types.Area) -> None:
    """Show the whole frame as large as the free part of a view that looks through the frame's camera allows."""
    margin = MARGIN_PX * bpy.context.preferences.system.ui_scale
    low, high = free_rectangle(area)
    view = FrameView.of(scene, window_region(area), area.spaces.active.region_3d)
    size = np.array(view.camera.size_wh)
    factor = float(np.min((high - low - 2 * margin) / size)) / view.magnification
    zoom_view(scene, area, view.region_from_px((size - 1) / 2), (low + high) / 2, factor)


def fit_soon(area: bpy.types.Area) -> None:
    """Fit the frame once the view has been drawn."""
    if bpy.app.background:
        return
    _waiting.add(area.as_pointer())
    start_timer(fit_waiting, DRAWN_S)


def fit_waiting() -> None:
    """Timer: fit the frame in the views that wait for it."""
    for window, area in areas("VIEW_3D"):
        if area.as_pointer() not in _waiting or window_region(area).width <= 1:
            continue
        with bpy.context.temp_override(window=window, area=area, region=window_region(area)):
            if from_scene.present_camera(window.scene) is not None and shows_frame(bpy.context):
                fit_frame(window.scene, area)
    _waiting.clear()


class ONEFRAME_OT_fit_frame(FrameTool):
    """Show the whole frame, beside toolbar and sidebar"""

    bl_label = "Fit Frame"
    bl_options = {"REGISTER"}

    def execute(self, context: bpy.types.Context) -> OperatorResult:
        fit_frame(context.scene, context.area)
        return {"FINISHED"}
