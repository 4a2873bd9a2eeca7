"""Drags with the mouse: each is one operator and one undo step, Esc takes it back."""

import bpy

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
