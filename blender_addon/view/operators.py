"""How the camera view shows surface and frame: opacity, wireframe, contour, comparisons; zoom to the pointer.

Opacity and wireframe are Blender's own display settings of the object; ``overlay`` draws the rest over the view.
Nothing here changes the pose: zoom and pan belong to the view.
"""

from collections.abc import Sequence

import bpy
import numpy as np
from bpy.props import BoolProperty, EnumProperty, FloatProperty, FloatVectorProperty

from ..registration import class_registration, prop
from ..state import from_scene
from ..ui.frame_view import FrameView, shows_frame, window_region
from ..ui.keymap import OBJECT_MODE, Key, Keys
from ..ui.operator import NeedsAlignment, OperatorResult, redraw

OPACITIES = (1.0, 0.6, 0.3, 0.0)
MAGNIFICATIONS = (1 / 16, 64.0)
"""Smallest and largest zoom in region pixels per frame pixel."""

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


def _opacity(self: bpy.types.PropertyGroup) -> float:
    surface = _surface(self.id_data)
    return 1.0 if surface is None else surface.color[3]


def _set_opacity(self: bpy.types.PropertyGroup, value: float) -> None:
    surface = _surface(self.id_data)
    if surface is not None:
        surface.color[3] = value


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
        name="Opacity", description="Opacity of the surface over the frame", min=0, max=1, get=_opacity,
        set=_set_opacity, subtype="FACTOR",
    ))  # fmt: skip
    wireframe: bool = prop(
        BoolProperty(
            name="Wireframe", description="Show the surface as a wireframe", get=_wireframe, set=_set_wireframe
        )
    )
    contour: bool = prop(
        BoolProperty(name="Contour", description="Draw outlines and creases of the surface over the frame")
    )
    crease_deg: float = prop(FloatProperty(
        name="Crease",
        description="Least change of the surface's normal within 6 px of the frame that counts as a crease, in degrees",
        min=5, max=120, default=60, precision=0, step=500,
    ))  # fmt: skip
    contour_color: Sequence[float] = prop(FloatVectorProperty(
        name="Contour Colour", description="Colour of the contour", subtype="COLOR_GAMMA", size=3, min=0, max=1,
        default=(0.1, 1.0, 0.95),
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


class _FrameTool(NeedsAlignment):
    """Mixin: available in 3D views that look through the frame's camera."""

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        if not super().poll(context):
            return False
        if not shows_frame(context):
            cls.poll_message_set("Look through the frame's camera first")
            return False
        return True


class _Toggle(_FrameTool):
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
        space, scene = context.space_data, context.scene
        scene.camera = from_scene.camera_object_of(scene)
        space.use_local_camera = False
        space.region_3d.view_perspective = "CAMERA"
        space.lock_camera = False
        return {"FINISHED"}


class ONEFRAME_OT_zoom_frame(_FrameTool, bpy.types.Operator):
    """Zoom the camera view about the pointer; the pose stays"""

    bl_idname = "oneframe.zoom_frame"
    bl_label = "Zoom Frame"
    bl_options = {"REGISTER"}

    factor: float = prop(
        FloatProperty(name="Factor", description="Change of the zoom", default=1.25, min=0.01, max=100)
    )
    magnification: float = prop(FloatProperty(
        name="Magnification",
        description="Screen pixels per pixel of the frame; 0 to use the factor",
        default=0, min=0, max=MAGNIFICATIONS[1],
    ))  # fmt: skip

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
    pointer: tuple[float, float],
    magnification: float,
) -> None:
    """Zoom a camera view to ``magnification`` region pixels per frame pixel, about the pointer."""
    before = FrameView.of(scene, region, region_3d)
    pixel = before.px_from_region(pointer)
    clipped = float(np.clip(magnification, *MAGNIFICATIONS))
    zoom = _zoom_factor(region_3d.view_camera_zoom) * clipped / before.magnification
    region_3d.view_camera_zoom = float(np.clip(50 * (2 * np.sqrt(zoom) - np.sqrt(2)), -30, 600))
    region_3d.update()
    shift = FrameView.of(scene, region, region_3d).region_from_px(pixel) - pointer
    # Blender's camera offset is in half widths of the region, at zoom factor 1
    zoom = _zoom_factor(region_3d.view_camera_zoom)
    size = np.array([region.width, region.height])
    region_3d.view_camera_offset = np.array(region_3d.view_camera_offset) + shift / (2 * zoom * size)
    region_3d.update()


def _zoom_factor(view_camera_zoom: float) -> float:
    """Convert Blender's ``view_camera_zoom`` to a factor."""
    return (np.sqrt(2) + view_camera_zoom / 50) ** 2 / 4


VIEW_OPERATORS = (
    ONEFRAME_OT_cycle_opacity,
    ONEFRAME_OT_toggle_wireframe,
    ONEFRAME_OT_toggle_contour,
    ONEFRAME_OT_toggle_blink,
    ONEFRAME_OT_toggle_swipe,
    ONEFRAME_OT_toggle_difference,
)
"""In the order of their keys."""
_CLASSES = (ONEFRAME_PG_view, *VIEW_OPERATORS, ONEFRAME_OT_show_frame, ONEFRAME_OT_zoom_frame)
_register_classes, _unregister_classes = class_registration(_CLASSES)
_KEYS = Keys(
    (
        *(
            Key(operator.bl_idname, digit, keymap=OBJECT_MODE)
            for operator, digit in zip(VIEW_OPERATORS, ("ONE", "TWO", "THREE", "FOUR", "FIVE", "SIX"), strict=True)
        ),
        Key("oneframe.zoom_frame", "WHEELINMOUSE", properties=(("factor", 1.25),)),
        Key("oneframe.zoom_frame", "WHEELOUTMOUSE", properties=(("factor", 0.8),)),
        Key("oneframe.zoom_frame", "SEVEN", properties=(("magnification", 1.0),), keymap=OBJECT_MODE),
    )
)


def register() -> None:
    """Register operators, settings and keys."""
    _register_classes()
    bpy.types.Scene.oneframe_view = bpy.props.PointerProperty(type=ONEFRAME_PG_view)
    _KEYS.register()


def unregister() -> None:
    """Undo :func:`register`."""
    _KEYS.unregister()
    del bpy.types.Scene.oneframe_view
    _unregister_classes()
