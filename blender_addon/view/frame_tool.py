"""Base class of the operators that work in views through the frame's camera."""

import bpy

from ..ui.frame_view import shows_frame
from ..ui.operator import NeedsAlignment


class FrameTool(NeedsAlignment):
    """Mixin: available in 3D views that look through the frame's camera."""

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Called by Blender."""
        if not super().poll(context):
            return False
        if not shows_frame(context):
            cls.poll_message_set("Look through the frame's camera first")
            return False
        return True
