"""Three areas beside the 3D view that show the slices; Blender's own Image Editor pans and zooms them.

Each shows an empty image of the slice's size, which tells the area's plane. The slice itself is drawn over it: voxels
never become part of the .blend file.
"""

import bpy

from ..class_registration import class_registration
from ..ui.frame_view import window_region
from ..ui.operator import Reporting
from .loaded import ct_of, loaded_ct
from .properties import SLICE_SPACE

MARK = "oneframe_slice"
"""Custom property of the empty images: number of the plane."""

SHARE = 0.25
"""Of the 3D view's width that the slices get."""

_LONGEST_PX = 1024
DRAWN_S = 0.1


def plane_of(space: bpy.types.Space | None) -> int | None:
    """Number of the plane, 0..2, that an Image Editor shows; ``None`` if it shows something else."""
    image = getattr(space, "image", None) if space is not None and space.type == SLICE_SPACE else None
    number = None if image is None else image.get(MARK)
    return number if number in (0, 1, 2) else None


def slice_areas(screen: bpy.types.Screen) -> list[bpy.types.Area]:
    """The areas of a screen that show slices."""
    return [area for area in screen.areas if plane_of(area.spaces.active) is not None]


def empty_image(number: int, scene: bpy.types.Scene) -> bpy.types.Image:
    """The image whose pixels have the shape of a plane's slices in millimetres."""
    plane = loaded_ct(scene).planes[number]
    name = f"OneFrame {plane.name}"
    found = next((image for image in bpy.data.images if image.get(MARK) == number), None)
    image = found or bpy.data.images.new(name, 1, 1)
    image[MARK] = number
    width, height = (count * mm for count, mm in zip(plane.size_wh, plane.pixel_mm, strict=True))
    factor = _LONGEST_PX / max(width, height)
    image.source = "GENERATED"
    image.generated_color = (0.0, 0.0, 0.0, 1.0)
    image.generated_width, image.generated_height = max(1, round(width * factor)), max(1, round(height * factor))
    # the areas alone would not keep it in the file
    image.use_fake_user = True
    return image


class ONEFRAME_OT_slices(Reporting, bpy.types.Operator):
    """Show axial, coronal and sagittal slices beside the 3D view; again: hide them"""

    bl_idname = "oneframe.slices"
    bl_label = "Slices"
    bl_options = {"REGISTER"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        if context.screen is not None and slice_areas(context.screen):
            return True
        if ct_of(context.scene) is not None:
            return True
        cls.poll_message_set("Open a CT first")
        return False

    def run(self, context: bpy.types.Context) -> None:
        if context.window is not None and slice_areas(context.screen):
            hide_slices(context.window)
        else:
            show_slices_soon()


def _open_next(window: bpy.types.Window) -> bool:
    """Open one more area left of the window's largest 3D view; returns whether there are three.

    One at a time: Blender knows the sizes of new areas once it has drawn them.
    """
    screen = window.screen
    images = [empty_image(number, window.scene) for number in range(3)]
    shown = slice_areas(screen)
    if len(shown) < 3:
        if shown:
            tallest = max(shown, key=lambda area: area.height)
            new = list(_split(window, tallest, "HORIZONTAL", 1 / 3 if len(shown) == 1 else 1 / 2))
        else:
            view = max(
                (area for area in screen.areas if area.type == "VIEW_3D"), key=lambda area: area.width, default=None
            )
            if view is None:
                return True
            new = [_split(window, view, "VERTICAL", SHARE)[0]]
        for area in new:
            _prepare(area, images[0])
        shown = slice_areas(screen)
    for area, image in zip(sorted(shown, key=lambda area: -area.y), images, strict=False):
        area.spaces.active.image = image
    return len(shown) == 3


def hide_slices(window: bpy.types.Window) -> None:
    """Close the areas with slices."""
    screen = window.screen
    while areas := slice_areas(screen):
        with bpy.context.temp_override(window=window, area=areas[0], region=window_region(areas[0])):
            if bpy.ops.screen.area_close() != {"FINISHED"}:
                return


def _split(
    window: bpy.types.Window, area: bpy.types.Area, direction: str, share: float
) -> tuple[bpy.types.Area, bpy.types.Area]:
    """Split an area: the new left or lower part, which gets the share of up to a half, and the rest."""
    screen = window.screen
    before = set(screen.areas)
    with bpy.context.temp_override(window=window, area=area, region=window_region(area)):
        bpy.ops.screen.area_split(direction=direction, factor=share)  # type: ignore[arg-type]
    (new,) = set(screen.areas) - before
    return new, area


def _prepare(area: bpy.types.Area, image: bpy.types.Image) -> None:
    """An Image Editor without anything around the slice."""
    area.type = "IMAGE_EDITOR"
    space = area.spaces.active
    space.image = image
    space.mode = "VIEW"
    for name in ("header", "tool_header", "toolbar", "ui", "hud"):
        region = f"show_region_{name}"
        if hasattr(space, region):
            setattr(space, region, False)
    space.show_gizmo = False


def _fit_soon() -> None:
    if not bpy.app.background and not bpy.app.timers.is_registered(_fit):
        bpy.app.timers.register(_fit, first_interval=DRAWN_S)


def _fit() -> float | None:
    """Timer: show whole slices, once the areas have been drawn and know their sizes."""
    for window in bpy.context.window_manager.windows:
        for area in slice_areas(window.screen):
            region = window_region(area)
            if region.width <= 1:
                return DRAWN_S
            with bpy.context.temp_override(window=window, area=area, region=region):
                bpy.ops.image.view_all(fit_view=True)
    return None


def show_slices_soon() -> None:
    """Show the slices once the window has arrived in the add-on's workspace."""
    if not bpy.app.background and not bpy.app.timers.is_registered(_show):
        bpy.app.timers.register(_show, first_interval=DRAWN_S)


def _show() -> float | None:
    from ..view.workspace import is_own

    waiting = False
    for window in bpy.context.window_manager.windows:
        if ct_of(window.scene) is None:
            continue
        ready = is_own(window.workspace) and all(
            window_region(area).width > 1 for area in window.screen.areas if area.type in ("VIEW_3D", SLICE_SPACE)
        )
        waiting |= not (ready and _open_next(window))
    if not waiting:
        _fit_soon()
    return DRAWN_S if waiting else None


_register, _unregister = class_registration((ONEFRAME_OT_slices,))


def register() -> None:
    """Register the operator."""
    _register()


def unregister() -> None:
    """Close the areas, and remove the empty images."""
    for timer in (_fit, _show):
        if bpy.app.timers.is_registered(timer):
            bpy.app.timers.unregister(timer)
    if not bpy.app.background:
        for window in bpy.context.window_manager.windows:
            hide_slices(window)
    bpy.data.batch_remove([image for image in bpy.data.images if MARK in image])
    _unregister()
