"""What draws over Blender's editors: classes that say when and what, drawn by one handler for each kind of editor."""

from functools import partial
from typing import Any, Literal

import bpy

from ..class_registration import Part
from ..pipeline.errors import InputError
from .strokes import Strokes, in_window_pixels


class Pane:
    """Something drawn over all editors of a kind. Every class of this kind is drawn; it has no instances."""

    space: type[bpy.types.Space] = bpy.types.SpaceView3D
    place: Literal["POST_VIEW", "POST_PIXEL"] = "POST_PIXEL"
    """With the objects of a 3D view, or over them, in pixels of the region."""
    order = 0
    """Panes of a higher order lie over the others."""

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Whether it is drawn now."""
        return True

    @classmethod
    def draw(cls, context: bpy.types.Context, strokes: Strokes) -> None:
        """Draw, and add lines and texts that are drawn next. An InputError ends it: the sidebar says what is wrong."""
        raise NotImplementedError


class PointerPane:
    """Something drawn at the pointer over 3D views, whenever that moves."""

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Whether it is drawn now."""
        return True

    @classmethod
    def draw(cls, context: bpy.types.Context, strokes: Strokes, pointer: tuple[int, int]) -> None:
        """Add lines and texts, in pixels of the window, as the pointer is."""
        raise NotImplementedError


def _draw(space: type[bpy.types.Space], place: str) -> None:
    context = bpy.context
    for pane in sorted(Pane.__subclasses__(), key=lambda pane: pane.order):
        if (pane.space, pane.place) != (space, place) or not pane.poll(context):
            continue
        strokes = Strokes()
        try:
            pane.draw(context, strokes)
        except InputError:
            continue
        strokes.draw()


def _draw_at(pointer: tuple[int, int]) -> None:
    context = bpy.context
    if context.region is None or context.region_data is None:
        return
    for pane in PointerPane.__subclasses__():
        if not pane.poll(context):
            continue
        strokes = Strokes()
        try:
            pane.draw(context, strokes, pointer)
        except InputError:
            continue
        with in_window_pixels():
            strokes.draw()


def _panes_of(space: Any, place: str) -> Part:
    handles: list[Any] = []
    return Part(
        lambda: handles.append(space.draw_handler_add(partial(_draw, space, place), (), "WINDOW", place)),
        lambda: space.draw_handler_remove(handles.pop(), "WINDOW"),
    )


def _panes_at_pointer() -> Part:
    handles: list[Any] = []
    return Part(
        lambda: handles.append(bpy.types.WindowManager.draw_cursor_add(_draw_at, (), "VIEW_3D", "WINDOW")),
        lambda: bpy.types.WindowManager.draw_cursor_remove(handles.pop()),
    )


PARTS = (
    _panes_of(bpy.types.SpaceView3D, "POST_VIEW"),
    _panes_of(bpy.types.SpaceView3D, "POST_PIXEL"),
    _panes_of(bpy.types.SpaceDopeSheetEditor, "POST_PIXEL"),
    _panes_at_pointer(),
)
