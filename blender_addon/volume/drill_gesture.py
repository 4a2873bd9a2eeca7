"""A drag of the burr: one operator and one undo step, as long as the mouse button is held; Esc takes it back."""

from dataclasses import dataclass, replace

import bpy
import numpy as np
from bpy.props import FloatProperty
from bpy_extras import view3d_utils

from ..class_registration import class_registration, prop
from ..pipeline.volume.bone.isosurface import RemovedField
from ..ui.keymap import DRILL_TOOL, Key, Keys, active_tool
from ..ui.operator import OperatorResult
from . import drill_session, drill_strokes
from .drill_drawing import world_from_mesh
from .drill_session import DrillSession
from .properties import redraw

DEPTH = 0.5
"""How deep a stroke goes, in radii of the burr."""

LEAST_STEP = 0.12
"""Between points of a stroke, in radii."""

APPROACH = 3.0
"""From so many radii outside, the burr comes towards the bone."""


@dataclass(frozen=True)
class Burr:
    """The burr under the pointer.

    Attributes
    ----------
    centre
        ``(3,)`` LPS, mm.
    radius_mm
        Its radius.
    stopped
        Whether a margin holds it back.
    structure, distance_mm
        The nearest structure, and its distance from the burr's surface; no name if there is none.
    """

    centre: np.ndarray
    radius_mm: float
    stopped: bool
    structure: str
    distance_mm: float


def burr_at(
    context: bpy.types.Context, session: DrillSession, removed: RemovedField | None, at: tuple[float, float]
) -> Burr | None:
    """The burr on the bone that a field has left, under a place of the region (px); ``None`` beside the bone."""
    region, region_3d = context.region, context.region_data
    origin = np.array(view3d_utils.region_2d_to_origin_3d(region, region_3d, at))
    toward = np.array(view3d_utils.region_2d_to_vector_3d(region, region_3d, at))
    mesh_from_world = np.linalg.inv(world_from_mesh(context.scene))
    origin = mesh_from_world[:3, :3] @ origin + mesh_from_world[:3, 3]
    toward = mesh_from_world[:3, :3] @ toward
    toward /= np.linalg.norm(toward)
    hit = session.hit(removed, origin, toward)
    if hit is None:
        return None
    radius = float(context.scene.oneframe_ct.burr_mm) / 2
    radius = float(drill_strokes.rounded(np.array(radius)))
    centre = hit - (1 - DEPTH) * radius * toward
    reached = session.reached(centre - APPROACH * radius * toward, centre, radius)
    stopped = bool(np.linalg.norm(reached - centre) > 1e-6)
    centre = drill_strokes.rounded(reached)
    near = session.nearest(centre)
    name, distance = ("", np.inf) if near is None else near
    return Burr(centre, radius, stopped, name, distance - radius)


class ONEFRAME_OT_drill_stroke(bpy.types.Operator):
    """Drag: remove bone with the burr"""

    bl_idname = "oneframe.drill_stroke"
    bl_label = "Drill"
    bl_options = {"UNDO", "BLOCKING"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Called by Blender."""
        return is_ready(context)

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> OperatorResult:
        """Called by Blender."""
        session = drill_session.of(context.scene)
        if session is None:
            return {"PASS_THROUGH"}
        removed = session.removed
        # the depth of a stroke counts from the bone before it
        self._before = None if removed is None else replace(removed, distance_mm=removed.distance_mm.copy())
        self._last: np.ndarray | None = None
        self._session = session
        self._drill(context, event)
        context.workspace.status_text_set("Esc or Right Click: Take Back the Stroke")
        context.window_manager.modal_handler_add(self)
        return {"RUNNING_MODAL"}

    def modal(self, context: bpy.types.Context, event: bpy.types.Event) -> OperatorResult:
        """Called by Blender."""
        if drill_session.of(context.scene) is not self._session:
            return self._end(context, undo=False)
        if event.type in ("ESC", "RIGHTMOUSE") and event.value == "PRESS":
            return self._end(context, undo=True)
        if event.type == "WINDOW_DEACTIVATE" or (event.type == "LEFTMOUSE" and event.value == "RELEASE"):
            return self._end(context, undo=False)
        if event.type == "MOUSEMOVE":
            self._drill(context, event)
        return {"RUNNING_MODAL"}

    def cancel(self, context: bpy.types.Context) -> None:
        """Called by Blender when something else ends the drag."""
        self._end(context, undo=True)

    def _drill(self, context: bpy.types.Context, event: bpy.types.Event) -> None:
        at = event.mouse_region_x + 0.5, event.mouse_region_y + 0.5
        burr = burr_at(context, self._session, self._before, at)
        if burr is None:
            return
        if self._last is None:
            self._session.begin(burr.radius_mm, burr.centre)
        elif np.linalg.norm(burr.centre - self._last) >= LEAST_STEP * burr.radius_mm:
            self._session.extend(burr.centre)
        else:
            return
        self._last = burr.centre
        redraw()

    def _end(self, context: bpy.types.Context, *, undo: bool) -> OperatorResult:
        context.workspace.status_text_set(None)
        drilled, self._last = self._last is not None, None
        if drilled and undo:
            self._session.undo()
        elif drilled:
            drill_strokes.set_strokes(context.scene, self._session.strokes)
        redraw()
        return {"FINISHED"} if drilled and not undo else {"CANCELLED"}


class ONEFRAME_OT_burr_size(bpy.types.Operator):
    """Change the diameter of the burr"""

    bl_idname = "oneframe.burr_size"
    bl_label = "Size of the Burr"
    bl_options = {"INTERNAL"}

    factor: float = prop(FloatProperty(name="Factor", default=1.25))

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Called by Blender."""
        return is_ready(context)

    def execute(self, context: bpy.types.Context) -> OperatorResult:
        """Called by Blender."""
        settings = context.scene.oneframe_ct
        settings.burr_mm = round(settings.burr_mm * self.factor, 1)
        return {"FINISHED"}


def is_ready(context: bpy.types.Context) -> bool:
    """Whether a drag drills: the tool is active in a 3D view, and the drill in use."""
    in_view = context.space_data is not None and context.space_data.type == "VIEW_3D"
    return in_view and active_tool(context) == DRILL_TOOL and drill_session.of(context.scene) is not None


_TOOLS = (DRILL_TOOL,)
_KEYS = Keys(
    (
        Key("oneframe.drill_stroke", "LEFTMOUSE", tools=_TOOLS),
        Key("oneframe.burr_size", "WHEELUPMOUSE", ctrl=True, properties=(("factor", 1.25),), tools=_TOOLS),
        Key("oneframe.burr_size", "WHEELDOWNMOUSE", ctrl=True, properties=(("factor", 0.8),), tools=_TOOLS),
        Key("oneframe.burr_size", "RIGHT_BRACKET", properties=(("factor", 1.25),), tools=_TOOLS),
        Key("oneframe.burr_size", "LEFT_BRACKET", properties=(("factor", 0.8),), tools=_TOOLS),
    )
)
register, unregister = class_registration((ONEFRAME_OT_drill_stroke, ONEFRAME_OT_burr_size), _KEYS)
