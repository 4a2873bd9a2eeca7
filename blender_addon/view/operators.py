"""How the camera view shows surface and frame: opacity, wireframe, contour, comparisons.

The wireframe is Blender's own display setting of the object; ``overlay`` draws the rest over the view. At first that is
the contour alone, over the full frame.
Nothing here changes the pose.
"""

from collections.abc import Sequence

import bpy
from bpy.props import BoolProperty, EnumProperty, FloatProperty, FloatVectorProperty

from ..class_registration import class_registration, prop
from ..state import camera_view, from_scene
from ..ui.frame_view import FrameView
from ..ui.keymap import Key, Keys
from ..ui.operator import OperatorResult, redraw
from .frame_tool import FrameTool

OPACITIES = (1.0, 0.6, 0.3, 0.0)
COMPARISONS = [
    ("NONE", "None", "Surface over the frame, as Blender shows it"),
    ("BLINK", "Blink", "Alternate between frame and surface twice a second: what jumps is not aligned"),
    ("SWIPE", "Swipe", "Frame to the left, surface to the right of a line that you can drag"),
    (
        "DIFFERENCE",
        "Difference",
        "Coloured surface: differences from the frame are bright. Plain surface: frame in red, surface in cyan, "
        "grey where they agree",
    ),
]


def _surface(scene: bpy.types.Scene) -> bpy.types.Object | None:
    return from_scene.surface_of(scene) if from_scene.is_set_up(scene) else None


def _wireframe(self: bpy.types.PropertyGroup) -> bool:
    surface = _surface(self.id_data)
    return surface is not None and surface.display_type == "WIRE"


def _set_wireframe(self: bpy.types.PropertyGroup, value: bool) -> None:
    surface = _surface(self.id_data)
    if surface is not None:
        surface.display_type = "WIRE" if value else "TEXTURED"


class ONEFRAME_PG_view(bpy.types.PropertyGroup):
    """Settings of the camera view."""

    opacity: float = prop(FloatProperty(
        name="Opacity", description="Opacity of the surface over the frame", min=0, max=1, default=0, subtype="FACTOR",
    ))  # fmt: skip
    wireframe: bool = prop(
        BoolProperty(
            name="Wireframe", description="Show the surface as a wireframe", get=_wireframe, set=_set_wireframe
        )
    )
    contour: bool = prop(
        BoolProperty(
            name="Contour", description="Draw outlines and creases of the surface over the frame", default=True
        )
    )
    crease_deg: float = prop(FloatProperty(
        name="Crease",
        description="Least change of the surface's normal within 6 px of the frame that counts as a crease, in degrees",
        min=5, max=120, default=60, precision=0, step=500,
    ))  # fmt: skip
    contour_color: Sequence[float] = prop(FloatVectorProperty(
        name="Contour Colour", description="Colour of the contour", subtype="COLOR_GAMMA", size=3, min=0, max=1,
        default=(1.0, 0.9, 0.15),
    ))  # fmt: skip
    comparison: str = prop(EnumProperty(name="Compare", description="Compare surface and frame", items=COMPARISONS))
    split: float = prop(FloatProperty(
        name="Line", description="Position of the line between frame and surface, as a fraction of the frame's width",
        min=0, max=1, default=0.5, subtype="FACTOR",
    ))  # fmt: skip
    gain: float = prop(
        FloatProperty(
            name="Gain",
            description="Factor by which the difference of a coloured surface is brightened",
            min=0.5,
            max=20,
            default=3.0,
        )
    )
    loupe: bool = prop(
        BoolProperty(
            name="Loupe", description="Magnify the surroundings of the pointer while you pick landmarks", default=True
        )
    )


class _Toggle(FrameTool):
    bl_options = {"REGISTER", "UNDO"}

    def execute(self, context: bpy.types.Context) -> OperatorResult:
        self.toggle(context, context.scene.oneframe_view)
        redraw(context)
        return {"FINISHED"}

    def toggle(self, context: bpy.types.Context, view: ONEFRAME_PG_view) -> None:
        """Change the setting."""
        raise NotImplementedError


class ONEFRAME_OT_cycle_opacity(_Toggle, bpy.types.Operator):
    """Cycle the opacity of the surface: 100, 60, 30, 0 %"""

    bl_idname = "oneframe.cycle_opacity"
    bl_label = "Cycle Opacity"

    def toggle(self, context: bpy.types.Context, view: ONEFRAME_PG_view) -> None:
        lower = [opacity for opacity in OPACITIES if opacity < view.opacity - 0.01]
        view.opacity = lower[0] if lower else OPACITIES[0]


class ONEFRAME_OT_toggle_wireframe(_Toggle, bpy.types.Operator):
    """Show the surface as a wireframe or solid"""

    bl_idname = "oneframe.toggle_wireframe"
    bl_label = "Wireframe"

    def toggle(self, context: bpy.types.Context, view: ONEFRAME_PG_view) -> None:
        view.wireframe = not view.wireframe


class ONEFRAME_OT_toggle_contour(_Toggle, bpy.types.Operator):
    """Draw outlines and creases of the surface over the frame"""

    bl_idname = "oneframe.toggle_contour"
    bl_label = "Contour"

    def toggle(self, context: bpy.types.Context, view: ONEFRAME_PG_view) -> None:
        view.contour = not view.contour


class ONEFRAME_OT_toggle_blink(_Toggle, bpy.types.Operator):
    """Alternate between frame and surface twice a second: what jumps is not aligned"""

    bl_idname = "oneframe.toggle_blink"
    bl_label = "Blink"

    def toggle(self, context: bpy.types.Context, view: ONEFRAME_PG_view) -> None:
        view.comparison = "NONE" if view.comparison == "BLINK" else "BLINK"


class ONEFRAME_OT_toggle_swipe(_Toggle, bpy.types.Operator):
    """Show the frame to the left and the surface to the right of a line; the key puts the line under the pointer"""

    bl_idname = "oneframe.toggle_swipe"
    bl_label = "Swipe"

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> OperatorResult:
        if context.region.type == "WINDOW":
            frame_view = FrameView.of(context.scene, context.region, context.region_data)
            column_px = frame_view.px_from_region([event.mouse_region_x, event.mouse_region_y])[0]
            fraction = (column_px + 0.5) / frame_view.camera.width
            if context.scene.oneframe_view.comparison != "SWIPE" and 0 < fraction < 1:
                context.scene.oneframe_view.split = fraction
        return self.execute(context)

    def toggle(self, context: bpy.types.Context, view: ONEFRAME_PG_view) -> None:
        view.comparison = "NONE" if view.comparison == "SWIPE" else "SWIPE"


class ONEFRAME_OT_toggle_difference(_Toggle, bpy.types.Operator):
    """Show where frame and surface differ"""

    bl_idname = "oneframe.toggle_difference"
    bl_label = "Difference"

    def toggle(self, context: bpy.types.Context, view: ONEFRAME_PG_view) -> None:
        view.comparison = "NONE" if view.comparison == "DIFFERENCE" else "DIFFERENCE"


class ONEFRAME_OT_show_frame(bpy.types.Operator):
    """Look through the frame's camera"""

    bl_idname = "oneframe.show_frame"
    bl_label = "Look Through Frame"
    bl_options = {"REGISTER"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return from_scene.is_set_up(context.scene) and context.area is not None and context.area.type == "VIEW_3D"

    def execute(self, context: bpy.types.Context) -> OperatorResult:
        camera_view.through_camera(context.scene, context.area)
        return {"FINISHED"}


VIEW_OPERATORS = (
    ONEFRAME_OT_cycle_opacity,
    ONEFRAME_OT_toggle_wireframe,
    ONEFRAME_OT_toggle_contour,
    ONEFRAME_OT_toggle_blink,
    ONEFRAME_OT_toggle_swipe,
    ONEFRAME_OT_toggle_difference,
)
"""In the order of their keys."""
_CLASSES = (ONEFRAME_PG_view, *VIEW_OPERATORS, ONEFRAME_OT_show_frame)
_KEYS = Keys(
    (
        *(
            Key(operator.bl_idname, digit)
            for operator, digit in zip(VIEW_OPERATORS, ("ONE", "TWO", "THREE", "FOUR", "FIVE", "SIX"), strict=True)
        ),
        Key("oneframe.zoom_frame", "WHEELINMOUSE", properties=(("factor", 1.25),)),
        Key("oneframe.zoom_frame", "WHEELOUTMOUSE", properties=(("factor", 0.8),)),
        Key("oneframe.zoom_frame", "SEVEN", properties=(("magnification", 1.0),)),
        Key("oneframe.fit_frame", "HOME"),
    )
)
_register, _unregister = class_registration(_CLASSES, _KEYS)


def register() -> None:
    """Register operators, settings and keys."""
    _register()
    bpy.types.Scene.oneframe_view = bpy.props.PointerProperty(type=ONEFRAME_PG_view)


def unregister() -> None:
    """Undo :func:`register`."""
    del bpy.types.Scene.oneframe_view
    _unregister()
