"""The drilled volume in memory while the drill is in use."""

import bpy


def of(scene: bpy.types.Scene):
    """The scene's drilled volume."""
    return None
