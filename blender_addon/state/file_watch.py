"""Whether files have changed, for drawing: a timer looks, since a drive on the network may take seconds to answer."""

from pathlib import Path

import bpy

from ..pipeline.errors import InputError
from . import from_scene

WATCH_S = 2.0

Stamp = tuple[int, int]
"""Modification time and size; (0, 0) for a file that cannot be read."""

_stamps: dict[Path, Stamp] = {}
_asked: set[Path] = set()
"""Files asked for since the timer last looked; it forgets all others."""


def known_stamp(path: Path) -> Stamp:
    """The file's stamp, at most :data:`WATCH_S` old. Looks at the disk only for a file that nobody asked for lately."""
    _asked.add(path)
    if path not in _stamps:
        _stamps[path] = _stamp(path)
        if not bpy.app.timers.is_registered(_watch):
            bpy.app.timers.register(_watch, first_interval=WATCH_S)
    return _stamps[path]


def _stamp(path: Path) -> Stamp:
    try:
        return from_scene.stamp(path)
    except InputError:
        return 0, 0


def _watch() -> float | None:
    """Timer: look at the files, and draw again what depends on one that has changed."""
    found = {path: _stamp(path) for path in _asked}
    changed = any(_stamps.get(path) != stamp for path, stamp in found.items())
    _stamps.clear()
    _stamps.update(found)
    _asked.clear()
    if changed:
        for window in bpy.context.window_manager.windows:
            for area in window.screen.areas:
                area.tag_redraw()
    return WATCH_S if _stamps else None


def register() -> None:
    """Nothing to do: watching starts with the first file."""


def unregister() -> None:
    """Stop watching."""
    if bpy.app.timers.is_registered(_watch):
        bpy.app.timers.unregister(_watch)
    _stamps.clear()
    _asked.clear()
