"""The strip as a gizmo: a drag on it scrubs, whatever tool is active, and does not reach that tool."""

from collections.abc import Iterable
from typing import Literal

import bpy

from ..class_registration import at_end
from ..state.events import redraw
from ..ui.operator import OperatorResult, WholeView
from . import session, shown_frame
from .strip_layout import StripLayout, film_in

_pointer: dict[int, tuple[float, float]] = {}
"""Where the pointer rests over the strip: by view, px of its region."""


def pointer_in(region: bpy.types.Region) -> tuple[float, float] | None:
    """The pointer's place over the strip of a view; ``None`` if it is elsewhere."""
    return _pointer.get(region.as_pointer())


class ONEFRAME_GT_strip(bpy.types.Gizmo):
    """Drag to look through the video"""

    def draw(self, context: bpy.types.Context) -> None:
        """Called by Blender; the strip draws itself."""

    def test_select(self, context: bpy.types.Context, location: Iterable[int]) -> int:
        """Called by Blender when the pointer moves."""
        x, y = location
        layout, before = StripLayout.of(context), pointer_in(context.region)
        _pointer.clear()
        if layout is not None and layout.contains(x, y):
            _pointer[context.region.as_pointer()] = float(x), float(y)
        if pointer_in(context.region) != before:
            context.region.tag_redraw()
        return 0 if pointer_in(context.region) else -1

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> OperatorResult:
        self._scrub(context, event)
        return {"RUNNING_MODAL"}

    def modal(
        self, context: bpy.types.Context, event: bpy.types.Event, tweak: set[Literal["PRECISE", "SNAP"]]
    ) -> OperatorResult:
        self._scrub(context, event)
        return {"RUNNING_MODAL"}

    def exit(self, context: bpy.types.Context, cancel: bool) -> None:
        film = session.of(context.scene)
        if film is not None:
            film.fetcher.want(film.shown)

    def _scrub(self, context: bpy.types.Context, event: bpy.types.Event) -> None:
        layout, film = StripLayout.of(context), film_in(context)
        if layout is None or film is None:
            return
        x = min(max(event.mouse_region_x + 0.5, layout.low[0]), layout.high[0])
        _pointer[context.region.as_pointer()] = x, float(event.mouse_region_y)
        at = film.at_time(layout.time_at(x))
        if at != film.shown or not shown_frame.is_shown(context.scene):
            shown_frame.show(context.scene, at)
        redraw()


class ONEFRAME_GGT_strip(WholeView):
    """The strip of a video"""

    bl_label = "Video"
    gizmo = "ONEFRAME_GT_strip"

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return film_in(context) is not None


PARTS = (at_end(_pointer.clear),)
