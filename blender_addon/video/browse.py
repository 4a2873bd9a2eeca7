"""Keys, wheel and buttons of the strip: step, go to the best frames, zoom the time axis, take.

The keys work where the pointer is over the strip; elsewhere they are those of the tool.
"""

from bisect import bisect_left, bisect_right

import bpy
from bpy.props import BoolProperty, FloatProperty, IntProperty

from ..class_registration import prop
from ..state import another_frame
from ..state.events import redraw
from ..ui.keymap import TOOLS, Key, Place, keys
from ..ui.operator import OperatorResult
from . import session, shown_frame, strip_layout
from .operators import NeedsFilm
from .strip_layout import StripLayout


class OverStrip(NeedsFilm):
    """Mixin: a key counts only where the pointer is over the strip."""

    counts_for_seen = False
    """Whether it also counts elsewhere in the view while that shows a frame of the film that is not the case's."""

    key: bool = prop(BoolProperty, description="Called by a key", options={"SKIP_SAVE", "HIDDEN"})

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> OperatorResult:
        layout = None
        if context.region is not None and context.region.type == "WINDOW":
            layout = StripLayout.of(context)
        inside = layout is not None and layout.contains(event.mouse_region_x, event.mouse_region_y)
        is_seen = self.counts_for_seen and another_frame.seen(context.scene) is not None
        if self.key and not (inside or is_seen):
            return {"PASS_THROUGH"}
        self.time_s = layout.time_at(event.mouse_region_x) if inside and layout is not None else None
        return self.execute(context)

    time_s: float | None = None
    """Under the pointer."""


def _show(context: bpy.types.Context, at: int) -> None:
    film = session.scored(context.scene)
    shown_frame.show(context.scene, at)
    film.span_s = strip_layout.following(film)


class ONEFRAME_OT_video_step(OverStrip):
    """Show the next or the previous frame of the video"""

    bl_label = "Next Frame"
    bl_options = {"INTERNAL"}
    counts_for_seen = True

    step: int = prop(IntProperty, "Step", default=1)

    def execute(self, context: bpy.types.Context) -> OperatorResult:
        _show(context, session.scored(context.scene).shown + self.step)
        return {"FINISHED"}


class ONEFRAME_OT_video_best(OverStrip):
    """Show the next or the previous one of the best frames of the video, in time"""

    bl_label = "Next Best"
    bl_options = {"INTERNAL"}

    step: int = prop(IntProperty, "Step", default=1)

    def execute(self, context: bpy.types.Context) -> OperatorResult:
        film = session.scored(context.scene)
        if not film.best:
            self.report({"INFO"}, "No frame of this video shows anything sharply")
            return {"CANCELLED"}
        in_time = sorted(film.best)
        if self.step > 0:
            number = bisect_right(in_time, film.shown) + self.step - 1
        else:
            number = bisect_left(in_time, film.shown) + self.step
        _show(context, in_time[number % len(in_time)])
        return {"FINISHED"}


class ONEFRAME_OT_video_zoom(OverStrip):
    """Zoom the time axis about the pointer"""

    bl_label = "Zoom Time"
    bl_options = {"INTERNAL"}

    factor: float = prop(FloatProperty, "Factor", "0 for the whole film", default=1.5, min=0, max=100)

    def execute(self, context: bpy.types.Context) -> OperatorResult:
        film = session.scored(context.scene)
        about = film.score.time_s if self.time_s is None else self.time_s
        film.span_s = strip_layout.zoomed(film, film.span_s, self.factor, about) if self.factor else film.whole_span_s
        redraw()
        return {"FINISHED"}


class ONEFRAME_OT_video_take_key(OverStrip):
    """Take the frame in view"""

    bl_label = "Take Frame"
    bl_options = {"INTERNAL"}

    def execute(self, context: bpy.types.Context) -> OperatorResult:
        # a key begins the thread, with its progress; scripts wait
        bpy.ops.oneframe.take_frame("INVOKE_DEFAULT")  # type: ignore[attr-defined]
        return {"FINISHED"}


_VIEW = Place("3D View", "VIEW_3D")


def _key(operator: str, kind: str, *, ctrl: bool = False, repeat: bool = False, **settings: object) -> Key:
    # in the add-on's tools and in all others
    given = (*settings.items(), ("key", True))
    return Key(operator, kind, ctrl=ctrl, repeat=repeat, properties=given, tools=tuple(TOOLS), places=(_VIEW,))


# of the bindings of a key, Blender tries the one that was added last first: this module comes after the tools
PARTS = (
    keys(
        _key("oneframe.video_zoom", "WHEELINMOUSE", factor=1.5),
        _key("oneframe.video_zoom", "WHEELOUTMOUSE", factor=1 / 1.5),
        _key("oneframe.video_zoom", "HOME", factor=0.0),
        _key("oneframe.video_step", "LEFT_ARROW", repeat=True, step=-1),
        _key("oneframe.video_step", "RIGHT_ARROW", repeat=True, step=1),
        _key("oneframe.video_best", "LEFT_ARROW", ctrl=True, repeat=True, step=-1),
        _key("oneframe.video_best", "RIGHT_ARROW", ctrl=True, repeat=True, step=1),
        _key("oneframe.video_take_key", "RET"),
        _key("oneframe.video_take_key", "NUMPAD_ENTER"),
    ),
)
