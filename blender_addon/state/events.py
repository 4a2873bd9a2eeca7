"""One place where "the landmarks have changed" is told to whoever solves and draws; properties know nothing of them."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager

import bpy

_listeners: list[Callable[[bpy.types.Scene], None]] = []
_untold: list[None] = []


def on_landmarks_changed(listener: Callable[[bpy.types.Scene], None]) -> None:
    """Call ``listener(scene)`` after every change of a landmark, until :func:`forget`."""
    _listeners.append(listener)


def forget(listener: Callable[[bpy.types.Scene], None]) -> None:
    """Call it no more."""
    _listeners.remove(listener)


def landmarks_changed(
    owner: bpy.types.PropertyGroup | bpy.types.Scene, _context: bpy.types.Context | None = None
) -> None:
    """Tell all listeners; usable as the ``update`` of a property."""
    if _untold:
        return
    scene = owner if isinstance(owner, bpy.types.Scene) else owner.id_data
    for listener in _listeners:
        listener(scene)


@contextmanager
def untold() -> Iterator[None]:
    """Changes within are not told: a case that is opened is no change by the user, several changes are told as one."""
    _untold.append(None)
    try:
        yield
    finally:
        _untold.pop()
