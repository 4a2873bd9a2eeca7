"""Says that something has changed: to Blender's windows, and to those who solve for the pose from the landmarks."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager

import bpy

landmark_listeners: list[Callable[[bpy.types.Scene], None]] = []
"""Called with the scene after every change of a landmark: properties need not know who solves for the pose."""

_muted: list[None] = []
"""One entry for each :func:`muted` block that is being executed."""


def landmarks_changed(
    owner: bpy.types.PropertyGroup | bpy.types.Scene, _context: bpy.types.Context | None = None
) -> None:
    """Notify all listeners; usable as the ``update`` of a property."""
    if _muted:
        return
    scene = owner if isinstance(owner, bpy.types.Scene) else owner.id_data
    for listener in landmark_listeners:
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


def areas(*kinds: str) -> Iterator[tuple[bpy.types.Window, bpy.types.Area]]:
    """The areas of these kinds in all windows."""
    for window in bpy.context.window_manager.windows:
        for area in window.screen.areas:
            if area.type in kinds:
                yield window, area


def redraw(_owner: object = None, _context: bpy.types.Context | None = None) -> None:
    """Draw 3D views and the Timeline again; usable as the ``update`` of a property."""
    for _window, area in areas("VIEW_3D", "DOPESHEET_EDITOR"):
        area.tag_redraw()
