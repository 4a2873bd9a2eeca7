"""Reads the CT again after undo, redo or opening a file, where the scene has another CT than the one in memory."""

import bpy
from bpy.app.handlers import persistent

from ..class_registration import Handlers
from ..ui.frame_view import window_region
from .loaded import ct_of, key_of

DRAWN_S = 0.2

_failed: set[object] = set()
"""What could not be read: the panel offers to try again."""


def _wanted(scene: bpy.types.Scene) -> bool:
    return key_of(scene) is not None and ct_of(scene) is None and key_of(scene) not in _failed


@persistent
def _after_change(*_: object) -> None:
    if not bpy.app.background and not bpy.app.timers.is_registered(_read):
        bpy.app.timers.register(_read, first_interval=DRAWN_S)


@persistent
def _after_load(*_: object) -> None:
    _failed.clear()
    _after_change()


def _read() -> None:
    """Timer: start reading, as the button does."""
    for window in bpy.context.window_manager.windows:
        if not _wanted(window.scene):
            continue
        view = next((area for area in window.screen.areas if area.type == "VIEW_3D"), None)
        if view is None:
            continue
        _failed.add(key_of(window.scene))
        with bpy.context.temp_override(window=window, area=view, region=window_region(view)):
            bpy.ops.oneframe.read_ct("INVOKE_DEFAULT")  # type: ignore[attr-defined]
        return


_HANDLERS = Handlers(
    (bpy.app.handlers.undo_post, _after_change),
    (bpy.app.handlers.redo_post, _after_change),
    (bpy.app.handlers.load_post, _after_load),
)


def register() -> None:
    """Watch for undo, redo and files."""
    _HANDLERS.register()


def unregister() -> None:
    """Stop watching."""
    _HANDLERS.unregister()
    if bpy.app.timers.is_registered(_read):
        bpy.app.timers.unregister(_read)
    _failed.clear()
