"""Notifies listeners that the landmarks have changed, so that properties need not know who solves for the pose."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager

import bpy

_listeners: list[Callable[[bpy.types.Scene], None]] = []
_muted: list[None] = []
"""One entry for each :func:`muted` block that is being executed."""


def on_landmarks_changed(listener: Callable[[bpy.types.Scene], None]) -> None:
    """Call ``listener(scene)`` after every change of a landmark, until :func:`remove_listener`."""
    _listeners.append(listener)


def remove_listener(listener: Callable[[bpy.types.Scene], None]) -> None:
    """Stop calling a listener."""
    _listeners.remove(listener)


def landmarks_changed(
    owner: bpy.types.PropertyGroup | bpy.types.Scene, _context: bpy.types.Context | None = None
) -> None:
    """Notify all listeners; usable as the ``update`` of a property."""
    if _muted:
        return
    scene = owner if isinstance(owner, bpy.types.Scene) else owner.id_data
    for listener in _listeners:
        listener(scene)


@contextmanager
def muted() -> Iterator[None]:
    """Do not notify listeners within this block.

    For changes that the user did not make, such as opening a case, and for several changes that notify once at the end.
    """
    _muted.append(None)
    try:
        yield
    finally:
        _muted.pop()
