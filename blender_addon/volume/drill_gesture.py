"""The tool with which the mouse drills. A drag is one operator and one undo step; Esc takes it back."""

from dataclasses import replace
from itertools import groupby

import bpy
import numpy as np

from ..class_registration import tool
from ..pipeline.volume.drill.burr import way_over_bone
from ..state import another_frame
from ..state.events import redraw
from ..ui.drag import BrushSize, BrushStroke, size_keys
from ..ui.keymap import DRILL_TOOL, TOOLS, Key, ViewTool, active_tool, keys
from ..ui.operator import OperatorResult
from . import drill_session, drill_strokes
from .drill_session import Burr, burr_at

LEAST_STEP, MOST_STEP = 0.12, 0.5
"""Between points of a stroke, in radii; however fast the pointer was, they follow the bone."""


class ONEFRAME_OT_drill_stroke(BrushStroke):
    """Drag: remove bone with the burr"""

    bl_label = "Drill"

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return is_ready(context)

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> OperatorResult:
        session = drill_session.of(context.scene)
        if session is None:
            return {"PASS_THROUGH"}
        removed = session.removed
        # the depth of a stroke counts from the bone before it
        self._before = None if removed is None else replace(removed, distance_mm=removed.distance_mm.copy())
        self._strokes, self._taken_mm3 = session.strokes, session.taken_mm3
        self._at: np.ndarray | None = None
        self._last: np.ndarray | None = None
        self._burr: Burr | None = None
        self._centres: dict[tuple[float, float], np.ndarray | None] = {}
        self._session = session
        return self.begin(context, event)

    def modal(self, context: bpy.types.Context, event: bpy.types.Event) -> OperatorResult:
        if drill_session.of(context.scene) is not self._session:
            return self.leave(context, undo=False)
        return super().modal(context, event)

    def go(self, context: bpy.types.Context, event: bpy.types.Event) -> None:
        radius = drill_session.burr_radius_mm(context.scene)
        at = np.array([event.mouse_region_x + 0.5, event.mouse_region_y + 0.5])
        start, self._at = at if self._at is None else self._at, at
        way = way_over_bone(lambda place: self._centre_at(context, place), start, at, MOST_STEP * radius)
        for _, group in groupby(way, lambda centre: centre is None):
            run = [centre for centre in group if centre is not None]
            if not run:
                # lifted: where it comes down again, another stroke begins
                self._last = None
                continue
            points: list[np.ndarray] = []
            for centre in run:
                if self._last is None:
                    self._session.begin(radius, centre)
                elif np.linalg.norm(centre - self._last) >= LEAST_STEP * radius:
                    points.append(centre)
                else:
                    continue
                self._last = centre
            self._session.extend(points)
        redraw()

    def _centre_at(self, context: bpy.types.Context, place: np.ndarray) -> np.ndarray | None:
        at = float(place[0]), float(place[1])
        if at not in self._centres:
            self._burr = burr_at(context, self._session, self._before, at)
            self._centres[at] = self._burr.centre if self._burr is not None and self._burr.has_room else None
        return self._centres[at]

    def end(self, context: bpy.types.Context, *, undo: bool) -> OperatorResult:
        session, drilled_mm3 = self._session, round(self._session.taken_mm3 - self._taken_mm3, 3)
        kept = drilled_mm3 > 0 and not undo
        if kept:
            drill_strokes.set_strokes(context.scene, session.strokes)
        else:
            session.follow(self._strokes)
        if not undo:
            session.said = f"drilled {drilled_mm3:.3g} mm³" if kept else f"drilled 0 mm³, not kept: {self._why_not()}"
            self.report({"INFO"}, session.said)
        redraw()
        return {"FINISHED"} if kept else {"CANCELLED"}

    def _why_not(self) -> str:
        if self._burr is None or self._burr.has_room:
            return "no bone under the pointer"
        return f"the margin of {self._burr.structure.replace('_', ' ')} stops the burr"


class ONEFRAME_OT_burr_size(BrushSize):
    """Change the diameter of the burr"""

    bl_label = "Size of the Burr"

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return is_ready(context)

    def execute(self, context: bpy.types.Context) -> OperatorResult:
        settings = context.scene.oneframe_ct
        settings.burr_mm = round(settings.burr_mm * self.factor, 1)
        return {"FINISHED"}


def is_ready(context: bpy.types.Context) -> bool:
    """Whether a drag drills: the tool is active in a 3D view, the drill in use, and the surface where it is seen."""
    in_view = context.space_data is not None and context.space_data.type == "VIEW_3D"
    is_used = active_tool(context) == DRILL_TOOL and drill_session.of(context.scene) is not None
    return in_view and is_used and another_frame.seen(context.scene) is None


class DrillTool(ViewTool):
    """Drill the bone of the CT with a spherical burr"""

    bl_idname = DRILL_TOOL
    bl_label = TOOLS[DRILL_TOOL]
    bl_description = (
        "Drill the bone of the CT with a spherical burr, which stops at the margins of structures.\n"
        "Drag: remove bone. Ctrl + Wheel, [ and ]: diameter of the burr. Ctrl + Z: take back a stroke"
    )
    bl_icon = "ops.sculpt.mask_by_color"

    @staticmethod
    def draw_settings(context: bpy.types.Context, layout: bpy.types.UILayout, _tool: bpy.types.WorkSpaceTool) -> None:
        if drill_session.of(context.scene) is None:
            layout.label(text="Press Drill in the panel CT first")
            return
        layout.prop(context.scene.oneframe_ct, "burr_mm")
        layout.label(text="Drag: Remove Bone    [ ]: Burr    Ctrl + Z: Undo Stroke")


_KEYS = keys(
    Key("oneframe.drill_stroke", "LEFTMOUSE", tools=(DRILL_TOOL,)),
    *size_keys("oneframe.burr_size", DRILL_TOOL),
)
PARTS = (tool(DrillTool, "oneframe.move_tool"), _KEYS)
