"""Three areas beside the 3D view that show the slices; Blender's own Image Editor pans and zooms them.

Each shows an empty image of the slice's size, which tells the area's plane. The slice itself is drawn over it: voxels
never become part of the .blend file.
"""

from dataclasses import dataclass

import bpy
import numpy as np
from bpy.app.handlers import persistent

from ..class_registration import at_end, listening, start_timer, timers
from ..pipeline.volume.slices.slice_planes import SlicePlane
from ..ui.frame_view import window_region
from ..ui.operator import Reporting
from .loaded import LoadedCT, ct_of, loaded_ct
from .properties import SLICE_SPACE

MARK = "oneframe_slice"
"""Custom property of the empty images: number of the plane."""

SHARE = 0.25
"""Of the 3D view's width that the slices get."""

_numbers: dict[int, int] = {}
"""Planes by the addresses of their areas: undo takes the empty images away, and with them what tells the planes."""

_LONGEST_PX = 1024
DRAWN_S = 0.1


def plane_of(space: bpy.types.Space | None) -> int | None:
    """Number of the plane, 0..2, that an Image Editor shows; ``None`` if it shows something else."""
    image = getattr(space, "image", None) if space is not None and space.type == SLICE_SPACE else None
    number = None if image is None else image.get(MARK)
    return number if number in (0, 1, 2) else None


def slice_areas(screen: bpy.types.Screen | None) -> list[bpy.types.Area]:
    """The areas of a screen that show slices."""
    areas = () if screen is None else screen.areas
    return [area for area in areas if plane_of(area.spaces.active) is not None]


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


@dataclass(frozen=True)
class SliceView:
    """A slice in a region: ``region = pixel * scale + offset``, in region pixels (origin bottom-left).

    Attributes
    ----------
    ct, plane
        What is shown.
    number
        Number of the slice: the one nearest to the scene's point.
    scale, offset
        ``(2,)``; the second scale is negative, since a region's y axis points up.
    """

    ct: LoadedCT
    plane: SlicePlane
    number: int
    scale: np.ndarray
    offset: np.ndarray

    @classmethod
    def of(cls, context: bpy.types.Context) -> "SliceView | None":
        """The slice in the context's region; ``None`` if it shows none, or the CT is not in memory."""
        number, ct, region = plane_of(context.space_data), ct_of(context.scene), context.region
        if number is None or ct is None or region is None or region.type != "WINDOW":
            return None
        plane = ct.planes[number]
        corners = (0.0, 0.0), (float(region.width), float(region.height))
        low, high = (np.array(region.view2d.region_to_view(*corner)) for corner in corners)
        px_per_unit = np.array(corners[1]) / (high - low)
        size = np.array(plane.size_wh)
        scale = px_per_unit / size * [1, -1]
        # the image's corners are those of the outermost pixels, half a pixel from their centres
        offset = -low * px_per_unit + [0.0, px_per_unit[1]] + 0.5 * scale
        return cls(ct, plane, shown_slice(context.scene, plane), scale, offset)

    def region_from_px(self, place: np.ndarray) -> np.ndarray:
        """``(2,)`` pixel of the slice -> region pixels."""
        return np.asarray(place) * self.scale + self.offset

    def px_from_region(self, place: np.ndarray) -> np.ndarray:
        """``(2,)`` region pixels -> pixel of the slice."""
        return (np.asarray(place) - self.offset) / self.scale


def shown_slice(scene: bpy.types.Scene, plane: SlicePlane) -> int:
    """Number of the slice through the scene's point."""
    place, _, _ = plane.place_of(np.array(scene.oneframe_ct.cursor_mm))
    return int(np.clip(np.rint(place), 0, plane.count - 1))


def inside(ct: LoadedCT, point_mm: np.ndarray) -> np.ndarray:
    """The nearest point ``(3,)`` between the centres of the outermost voxels, LPS, mm."""
    plane = ct.planes[0]
    number, u, v = plane.place_of(point_mm)
    width, height = plane.size_wh
    return plane.point_at(
        *(float(np.clip(at, 0, n - 1)) for at, n in zip((number, u, v), (plane.count, width, height), strict=True))
    )


class ONEFRAME_OT_slices(Reporting):
    """Show axial, coronal and sagittal slices beside the 3D view; again: hide them"""

    bl_label = "Slices"
    bl_options = {"REGISTER"}

    needs = (lambda context: ct_of(context.scene) is not None or slice_areas(context.screen), "Open a CT first")

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
    for number, area in enumerate(sorted(shown, key=lambda area: -area.y)):
        area.spaces.active.image = images[number]
        _numbers[area.as_pointer()] = number
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


@persistent
def fill_slices_soon(*_: object) -> None:
    """Show the slices again in areas that have lost them, by undo or while the CT was not in memory."""
    if not bpy.app.background:
        start_timer(_fill, DRAWN_S)


def _fill() -> None:
    for window in bpy.context.window_manager.windows:
        for area in window.screen.areas if ct_of(window.scene) is not None else ():
            space, number = area.spaces.active, _numbers.get(area.as_pointer())
            if number is not None and space.type == SLICE_SPACE and space.image is None:
                space.image = empty_image(number, window.scene)
                # without an image, the area has lost its zoom
                start_timer(_fit, DRAWN_S)


def show_slices_soon() -> None:
    """Show the slices once the window has arrived in the add-on's workspace."""
    if not bpy.app.background:
        start_timer(_show, DRAWN_S)


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
        start_timer(_fit, DRAWN_S)
    return DRAWN_S if waiting else None


def _close() -> None:
    if not bpy.app.background:
        for window in bpy.context.window_manager.windows:
            hide_slices(window)
    bpy.data.batch_remove([image for image in bpy.data.images if MARK in image])


PARTS = (
    listening(bpy.app.handlers.undo_post, fill_slices_soon),
    listening(bpy.app.handlers.redo_post, fill_slices_soon),
    at_end(_close, _numbers.clear),
    timers(_fill, _fit, _show),
)
