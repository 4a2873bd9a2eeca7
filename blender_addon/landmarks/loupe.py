"""A loupe next to the pointer while landmarks are picked: it shows the frame or the surface, whichever the next click
is for; while an image point is dragged, the frame under it, at any zoom and even under the surface."""

from collections.abc import Sequence

import bpy
import gpu
import numpy as np

from ..class_registration import cursor
from ..pipeline.alignment.manual.picking import asked_half
from ..pipeline.errors import InputError
from ..state import from_scene
from ..state.landmarks import landmarks_model
from ..ui.frame_view import FrameView, shows_frame
from ..ui.strokes import Colour, Strokes, in_window_pixels
from ..view.overlay import Composite, frame_image_of, picture_of, projection_of
from ..view.zoom import free_rectangle
from . import gestures, tool
from .marks import LandmarkView, marks_of

TOOL = tool.TOOL
"""A workspace tool that shows it."""

MAGNIFICATION = 6.0
"""In the camera view: screen pixels per pixel of the frame. In other views: relative to the view."""

SURFACE_MAGNIFICATION = 3.0
"""Of the surface in the camera view: without the frame's detail, its shape is recognised by more of it."""

DRAG_MAGNIFICATION = 3.0
"""While an image point is dragged: relative to the view, and at least this many screen pixels per frame pixel."""

MIN_MAGNIFICATION = 1.5
"""Least magnification relative to the camera view; a view that is zoomed in further shows no loupe."""

SIZE_PX, LARGEST_SHARE = 180, 0.4
"""At interface scale 1, and of the view's free width and height."""

DISTANCE_PX = 28
"""Distance of the loupe from the pointer."""

TARGET_PX = 24
"""The loupe keeps this distance from places where the next click is expected, at interface scale 1."""

WHITE: Colour = (1.0, 1.0, 1.0, 1.0)

_PICTURE_KEY = -1


def is_wanted(context: bpy.types.Context) -> bool:
    """Whether to show the loupe: it is switched on or a mark is dragged, and a click of the tool picks or pulls."""
    is_on = context.scene.oneframe_view.loupe or gestures.running() is not None
    return from_scene.is_set_up(context.scene) and is_on and tool.is_waiting(context)


def draw_loupe(pointer: tuple[int, int]) -> None:
    """Draw next to the pointer (window px); called by Blender for the region under it, whenever it moves."""
    context = bpy.context
    region = context.region
    if region is None or context.region_data is None or not is_wanted(context):
        return
    at = np.array([pointer[0] - region.x + 0.5, pointer[1] - region.y + 0.5])
    in_frame = shows_frame(context) and frame_image_of(context.scene) is not None
    shows_surface = not in_frame or _asks_for_surface(context.scene)
    gesture = gestures.running()
    if gesture is not None:
        shows_surface, at = gesture.moves == "point" or not in_frame, gesture.at
    low, high = free_rectangle(context.area)
    if not ((at >= low).all() and (at < high).all()):
        return
    try:
        _draw(context, region, at, in_frame=in_frame, shows_surface=shows_surface)
    except InputError:
        # the panel reports it
        return


def _asks_for_surface(scene: bpy.types.Scene) -> bool:
    return asked_half(landmarks_model(scene), scene.oneframe.landmark_index) == "point"


def targets(context: bpy.types.Context) -> list[np.ndarray]:
    """``(2,)`` region pixels near which the next click is expected: the marks of landmarks that lack a point."""
    view, entries = LandmarkView.of(context), context.scene.oneframe.landmarks
    found = []
    for mark in marks_of(context.scene, view):
        entry = entries[mark.index]
        place = mark.surface if mark.image is None else mark.image
        if entry.has_point != entry.has_pixel and place is not None:
            found.append(place)
    return found


def _draw(
    context: bpy.types.Context, region: bpy.types.Region, at: np.ndarray, *, in_frame: bool, shows_surface: bool
) -> None:
    scene = context.scene
    size = size_in(context.area)
    # Blender draws cursors in pixels of the window
    left, below, *_ = gpu.state.viewport_get()
    dragged = gestures.running() is not None
    low = corner(context.area, at, size, [] if dragged else targets(context))
    low = low + np.array([region.x - left, region.y - below])
    loupe_view, magnification = None, MAGNIFICATION
    if in_frame:
        frame_view = FrameView.of(scene, region, context.region_data)
        magnification = (SURFACE_MAGNIFICATION if shows_surface else MAGNIFICATION) / frame_view.magnification
        if dragged and not shows_surface:
            magnification = max(DRAG_MAGNIFICATION, DRAG_MAGNIFICATION / frame_view.magnification)
        if magnification < MIN_MAGNIFICATION:
            # the view itself is a loupe
            return
        offset = low + size / 2 - magnification * (at - frame_view.offset)
        loupe_view = FrameView(frame_view.camera, magnification * frame_view.scale, offset)
    projection = projection_of(scene, region, context.region_data, frame=in_frame)
    projection = projection.magnified(at[0], at[1], magnification, size, size)
    view = scene.oneframe_view
    contour = in_frame and view.contour and not shows_surface and not dragged
    picture = picture_of(_PICTURE_KEY, size, size)
    if contour or shows_surface:
        picture.draw(projection, from_scene.surface_of(scene), view.crease_deg if contour else None)
    mode = "FRAME" if not shows_surface else "SURFACE" if in_frame else "PICTURE"
    image = frame_image_of(scene) if in_frame else None
    composite = Composite(mode, loupe_view, image, picture, contour, tuple(low), target_encodes=False)
    composite.draw(view, tuple(low), tuple(low + size))
    with in_window_pixels():
        strokes = Strokes()
        strokes.line(low + size * np.array([[0, 0], [1, 0], [1, 1], [0, 1]]), WHITE, width=1.0, closed=True)
        # a gap at the centre
        strokes.cross(low + size / 2, size / 15 / strokes.unit, size / 2 / strokes.unit, WHITE, width=1.0)
        if dragged and loupe_view is not None:
            u, v = frame_view.px_from_region(at)
            strokes.text(low + 6 * strokes.unit, f"{u:.1f}, {v:.1f} px", WHITE)
        strokes.draw()


def size_in(area: bpy.types.Area) -> int:
    """Width and height of the loupe in a view, px."""
    low, high = free_rectangle(area)
    return round(min(SIZE_PX * bpy.context.preferences.system.ui_scale, LARGEST_SHARE * float((high - low).min())))


def corner(area: bpy.types.Area, at: np.ndarray, size: int, avoided: Sequence[np.ndarray]) -> np.ndarray:
    """``(2,)`` lower left corner of the loupe, region px, for a pointer ``at`` a place.

    Of the four places around the pointer, the first that no panel covers and that covers no ``avoided`` place; if there
    is none, the one that comes nearest to it.
    """
    free_low, free_high = free_rectangle(area)
    margin = TARGET_PX * bpy.context.preferences.system.ui_scale
    best, least = np.zeros(2), np.inf
    # above and left first: the text next to the pointer is right of it
    for side in np.array([(-1, 1), (1, 1), (-1, -1), (1, -1)]):
        low = np.asarray(at) + np.where(side > 0, DISTANCE_PX, -DISTANCE_PX - size)
        outside = np.maximum(free_low - low, 0) + np.maximum(low + size - free_high, 0)
        covered = sum(bool((place > low - margin).all() and (place < low + size + margin).all()) for place in avoided)
        cost = float(outside.sum()) + size * covered
        if cost < least:
            best, least = low, cost
    return np.round(np.clip(best, free_low, np.maximum(free_high - size, free_low)))


PARTS = (cursor(draw_loupe),)
