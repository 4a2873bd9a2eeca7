"""Fits the whole frame into the part of a 3D view that no toolbar, sidebar or header covers."""

from collections.abc import Callable

import bpy
import numpy as np

from ..class_registration import class_registration, start_timer
from ..state import from_scene
from ..state.events import areas
from ..ui.frame_view import FrameView, shows_frame, window_region
from ..ui.operator import OperatorResult
from .zoom import FrameTool, zoom_view

MARGIN_PX = 8
"""Between the frame and what surrounds it, at interface scale 1."""

DRAWN_S = 0.05
"""Time after which a view has been drawn once; before that its regions have no sizes."""

_waiting: set[int] = set()
reserved: list[Callable[[bpy.types.Area], float]] = []
"""Functions of a 3D view: the height, px, at its bottom that is left to what draws there."""


def free_rectangle(area: bpy.types.Area) -> tuple[np.ndarray, np.ndarray]:
    """Lower left and upper right corner (px of the view's region) of what is left of a 3D view for frame and loupe."""
    low, high = uncovered_rectangle(area)
    below = max((height_of(area) for height_of in reserved), default=0.0)
    low = np.maximum(low, [0.0, below])
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


register, unregister = class_registration(__name__)
