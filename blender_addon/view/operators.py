"""How the camera view shows surface and frame: opacity, wireframe, contour.

The wireframe is Blender's own display setting of the object; ``overlay`` draws the rest over the view. At first that is
the contour over the full frame, with a ghost of the surface until its pose is found.
Nothing here changes the pose.
"""

from collections.abc import Sequence

import bpy
from bpy.props import BoolProperty, FloatProperty, FloatVectorProperty

from ..class_registration import attached, prop
from ..state import camera_view, from_scene
from ..state.events import redraw
from ..state.initial_pose import is_sought
from ..ui.keymap import Key, keys
from ..ui.operator import OperatorResult
from .zoom import FrameTool

OPACITIES = (1.0, 0.6, 0.3, 0.0)
GHOST = 0.3
"""Opacity until a pose is found, unless the user has set one: nobody can pin what he cannot see."""


def _opacity(self: bpy.types.PropertyGroup) -> float:
    if self.chosen_opacity >= 0:  # type: ignore[attr-defined]  # of ONEFRAME_PG_view
        return self.chosen_opacity  # type: ignore[attr-defined]
    return GHOST if is_sought(self.id_data) else 0.0


def _set_opacity(self: bpy.types.PropertyGroup, value: float) -> None:
    self.chosen_opacity = value  # type: ignore[attr-defined]


class ONEFRAME_PG_view(bpy.types.PropertyGroup):
    """Settings of the camera view."""

    opacity: float = prop(
        FloatProperty,
        "Opacity",
        "Opacity of the surface over the frame",
        min=0,
        max=1,
        subtype="FACTOR",
        get=_opacity,
        set=_set_opacity,
    )
    chosen_opacity: float = prop(
        FloatProperty, description="Opacity that the user has set; -1 for none", default=-1, options={"HIDDEN"}
    )
    contour: bool = prop(
        BoolProperty, "Contour", "Draw outlines and creases of the surface over the frame", default=True, update=redraw
    )
    contour_color: Sequence[float] = prop(
        FloatVectorProperty,
        "Contour Colour",
        "Colour of the contour",
        subtype="COLOR_GAMMA",
        size=3,
        min=0,
        max=1,
        default=(1.0, 0.9, 0.15),
    )


WIREFRAME = (("data_path", "scene.oneframe.surface.display_type"), ("value_1", "TEXTURED"), ("value_2", "WIRE"))
CONTOUR = (("data_path", "scene.oneframe_view.contour"),)
"""Settings with which Blender's operators toggle these."""


class ONEFRAME_OT_cycle_opacity(FrameTool):
    """Cycle the opacity of the surface: 100, 60, 30, 0 %"""

    bl_label = "Cycle Opacity"
    bl_options = {"REGISTER", "UNDO"}

    def execute(self, context: bpy.types.Context) -> OperatorResult:
        view = context.scene.oneframe_view
        lower = [opacity for opacity in OPACITIES if opacity < view.opacity - 0.01]
        view.opacity = lower[0] if lower else OPACITIES[0]
        redraw()
        return {"FINISHED"}


class ONEFRAME_OT_show_frame(bpy.types.Operator):
    """Look through the frame's camera"""

    bl_label = "Look Through Frame"
    bl_options = {"REGISTER"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return from_scene.is_set_up(context.scene) and context.area is not None and context.area.type == "VIEW_3D"

    def execute(self, context: bpy.types.Context) -> OperatorResult:
        camera_view.through_camera(context.scene, context.area)
        return {"FINISHED"}


PARTS = (
    attached(bpy.types.Scene, "oneframe_view", ONEFRAME_PG_view),
    keys(
        Key("oneframe.cycle_opacity", "ONE"),
        Key("wm.context_toggle_enum", "TWO", properties=WIREFRAME),
        Key("wm.context_toggle", "THREE", properties=CONTOUR),
        Key("oneframe.zoom_frame", "WHEELINMOUSE", properties=(("factor", 1.25),)),
        Key("oneframe.zoom_frame", "WHEELOUTMOUSE", properties=(("factor", 0.8),)),
        Key("oneframe.zoom_frame", "SEVEN", properties=(("to_pixels", True),)),
        Key("oneframe.fit_frame", "HOME"),
    ),
)
