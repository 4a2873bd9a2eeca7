"""Zooms the camera view about the pointer. Zoom and pan belong to the view: nothing here moves an object."""

import bpy
import numpy as np
from bpy.props import FloatProperty
from numpy.typing import ArrayLike

from ..class_registration import class_registration, prop
from ..ui.frame_view import FrameView, shows_frame, window_region
from ..ui.operator import NeedsAlignment, OperatorResult, available

MAGNIFICATIONS = (1 / 16, 64.0)
"""Smallest and largest zoom in region pixels per frame pixel."""


class FrameTool(NeedsAlignment):
    """Mixin: available in 3D views that look through the frame's camera."""

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return super().poll(context) and available(cls, shows_frame(context), "Look through the frame's camera first")


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


register, unregister = class_registration(__name__)
