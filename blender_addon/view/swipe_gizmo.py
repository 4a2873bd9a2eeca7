"""The grip on the line of the swipe comparison: a gizmo, so that dragging it does not reach the active tool."""

from collections.abc import Iterable
from typing import Literal

import bpy
import numpy as np

from ..state import from_scene
from ..state.events import redraw
from ..ui.frame_view import FrameView, shows_frame
from ..ui.operator import OperatorResult, WholeView
from ..ui.strokes import Strokes

GRIP_PX = 9.0
"""Radius of the grip at interface scale 1; the mouse catches it within 1.5 times this."""


class ONEFRAME_GT_split(bpy.types.Gizmo):
    """Drag the line between frame and surface"""

    def draw(self, context: bpy.types.Context) -> None:
        grip = _grip(context)
        colour = (1.0, 0.75, 0.2, 1.0) if self.is_highlight or self.is_modal else (1.0, 1.0, 1.0, 1.0)
        strokes = Strokes()
        strokes.circle(np.array(grip), GRIP_PX, colour)
        strokes.circle(np.array(grip), GRIP_PX / 3, colour)
        strokes.draw()

    def test_select(self, context: bpy.types.Context, location: Iterable[int]) -> int:
        grip_x, grip_y = _grip(context)
        x, y = location
        reach = 1.5 * GRIP_PX * context.preferences.system.ui_scale
        return 0 if (x - grip_x) ** 2 + (y - grip_y) ** 2 < reach**2 else -1

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> OperatorResult:
        self._before = context.scene.oneframe_view.split
        return {"RUNNING_MODAL"}

    def modal(
        self, context: bpy.types.Context, event: bpy.types.Event, tweak: set[Literal["PRECISE", "SNAP"]]
    ) -> OperatorResult:
        frame_view = FrameView.of(context.scene, context.region, context.region_data)
        px = frame_view.px_from_region([event.mouse_region_x, event.mouse_region_y])[0]
        context.scene.oneframe_view.split = (px + 0.5) / frame_view.camera.width
        redraw()
        return {"RUNNING_MODAL"}

    def exit(self, context: bpy.types.Context, cancel: bool) -> None:
        if cancel:
            context.scene.oneframe_view.split = self._before


class ONEFRAME_GGT_split(WholeView):
    """The grip of the swipe"""

    bl_label = "Swipe"
    gizmo = "ONEFRAME_GT_split"

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return (
            from_scene.is_set_up(context.scene)
            and context.scene.oneframe_view.comparison == "SWIPE"
            and shows_frame(context)
        )


def _grip(context: bpy.types.Context) -> tuple[float, float]:
    """Position of the grip in the region, px: on the line, at half the region's height."""
    frame_view = FrameView.of(context.scene, context.region, context.region_data)
    width = frame_view.camera.width
    x = frame_view.region_from_px([context.scene.oneframe_view.split * width - 0.5, 0.0])[0]
    return float(x), context.region.height / 2
