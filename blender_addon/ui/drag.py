"""Drags with the mouse: each is one operator and one undo step, Esc takes it back; and keys for the size of a brush."""

import bpy
from bpy.props import FloatProperty

from ..class_registration import prop
from .keymap import Key
from .operator import OperatorResult


class Drag(bpy.types.Operator):
    """Mixin: a drag, from the press of the button until it is let go."""

    bl_options = {"UNDO", "BLOCKING"}
    button = "LEFTMOUSE"
    hint: str | None = None
    """What the status bar says meanwhile."""

    def go(self, context: bpy.types.Context, event: bpy.types.Event) -> None:
        """The pointer has moved."""
        raise NotImplementedError

    def end(self, context: bpy.types.Context, *, undo: bool) -> OperatorResult:
        """Keep what the drag did or take it back."""
        raise NotImplementedError

    def begin(self, context: bpy.types.Context, event: bpy.types.Event) -> OperatorResult:
        """What ``invoke`` returns."""
        self.go(context, event)
        context.workspace.status_text_set(self.hint)
        context.window_manager.modal_handler_add(self)
        return {"RUNNING_MODAL"}

    def modal(self, context: bpy.types.Context, event: bpy.types.Event) -> OperatorResult:
        if event.type in {"ESC", "RIGHTMOUSE"} - {self.button} and event.value == "PRESS":
            return self.leave(context, undo=True)
        if event.type == "WINDOW_DEACTIVATE" or (event.type == self.button and event.value == "RELEASE"):
            return self.leave(context, undo=False)
        if event.type == "MOUSEMOVE":
            self.go(context, event)
        return {"RUNNING_MODAL"}

    def cancel(self, context: bpy.types.Context) -> None:
        """Called by Blender when something else ends the drag."""
        self.leave(context, undo=True)

    def leave(self, context: bpy.types.Context, *, undo: bool) -> OperatorResult:
        """End the drag."""
        context.workspace.status_text_set(None)
        return self.end(context, undo=undo)


class BrushStroke(Drag):
    """Mixin: a stroke of a round brush."""

    hint = "Esc or Right Click: Take Back the Stroke"


class BrushSize(bpy.types.Operator):
    """Mixin: change the size of the brush by a factor."""

    bl_options = {"INTERNAL"}

    factor: float = prop(FloatProperty, "Factor", default=1.25)


def size_keys(operator: str, tool: str) -> tuple[Key, ...]:
    """The keys of a :class:`BrushSize`: Ctrl with the wheel, [ and ]."""
    larger, smaller = (("factor", 1.25),), (("factor", 0.8),)
    return (
        Key(operator, "WHEELUPMOUSE", ctrl=True, properties=larger, tools=(tool,)),
        Key(operator, "WHEELDOWNMOUSE", ctrl=True, properties=smaller, tools=(tool,)),
        Key(operator, "RIGHT_BRACKET", properties=larger, tools=(tool,)),
        Key(operator, "LEFT_BRACKET", properties=smaller, tools=(tool,)),
    )
