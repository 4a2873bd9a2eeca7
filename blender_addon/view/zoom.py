"""Zooms the camera view about the pointer, or fits the whole frame into what no toolbar, sidebar or header covers.

Zoom and pan belong to the view: nothing here moves an object.
"""

import bpy
import numpy as np
from bpy.props import FloatProperty
from numpy.typing import ArrayLike

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
    magnification: float = prop(
        FloatProperty,
        "Magnification",
        "Screen pixels per pixel of the frame; 0 to use the factor",
        min=0,
        max=MAGNIFICATIONS[1],
    )

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> OperatorResult:
        region = window_region(context.area)
        self._pointer: tuple[float, float] = (event.mouse_x - region.x, event.mouse_y - region.y)
        if context.region.type != "WINDOW":
            self._pointer = (region.width / 2, region.height / 2)
        return self._zoom(context, region)

    def execute(self, context: bpy.types.Context) -> OperatorResult:
        region = window_region(context.area)
        self._pointer = (region.width / 2, region.height / 2)
        return self._zoom(context, region)

    def _zoom(self, context: bpy.types.Context, region: bpy.types.Region) -> OperatorResult:
        region_3d = context.space_data.region_3d
        current = FrameView.of(context.scene, region, region_3d).magnification
        zoom_view(context.scene, region, region_3d, self._pointer, self.magnification or self.factor * current)
        context.area.tag_redraw()
        return {"FINISHED"}


def zoom_view(
    scene: bpy.types.Scene,
    region: bpy.types.Region,
    region_3d: bpy.types.RegionView3D,
    pointer: ArrayLike,
    magnification: float,
    *,
    to: ArrayLike | None = None,
) -> None:
    """Zoom a camera view to ``magnification`` region pixels per frame pixel.

    What is at ``pointer`` (region px) stays there, or moves ``to`` another place.
    """
    before = FrameView.of(scene, region, region_3d)
    pixel = before.px_from_region(pointer)
    clipped = float(np.clip(magnification, *MAGNIFICATIONS))
    zoom = _zoom_factor(region_3d.view_camera_zoom) * clipped / before.magnification
    region_3d.view_camera_zoom = float(np.clip(50 * (2 * np.sqrt(zoom) - np.sqrt(2)), -30, 600))
    region_3d.update()
    shift = FrameView.of(scene, region, region_3d).region_from_px(pixel) - np.asarray(pointer if to is None else to)
    # Blender's camera offset is in half widths of the region, at zoom factor 1
    zoom = _zoom_factor(region_3d.view_camera_zoom)
    size = np.array([region.width, region.height])
    region_3d.view_camera_offset = np.array(region_3d.view_camera_offset) + shift / (2 * zoom * size)
    region_3d.update()


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
    region, region_3d = window_region(area), area.spaces.active.region_3d
    margin = MARGIN_PX * bpy.context.preferences.system.ui_scale
    low, high = free_rectangle(area)
    view = FrameView.of(scene, region, region_3d)
    width, height = view.camera.size_wh
    middle = np.array([(width - 1) / 2, (height - 1) / 2])
    magnification = float(np.min((high - low - 2 * margin) / [width, height]))
    zoom_view(scene, region, region_3d, view.region_from_px(middle), magnification, to=(low + high) / 2)
    area.tag_redraw()


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
