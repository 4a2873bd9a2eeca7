"""The scene in which the add-on works: its own, so that nothing in the user's scenes changes.

Opening a case, or loading the first frame, K or surface, makes the scene and shows it in the window. The window's
interface follows: ``view.workspace`` listens with :func:`on_entered`.
"""

from collections.abc import Callable

import bpy

NAME = "OneFrame"
MARK = "oneframe_workbench"
"""Custom property of the add-on's scene."""

_listeners: list[Callable[[bpy.types.Window, bpy.types.Scene], None]] = []


def on_entered(listener: Callable[[bpy.types.Window, bpy.types.Scene], None]) -> None:
    """Call ``listener(window, left)`` when the add-on sets something up, until :func:`remove_listener`.

    ``left`` is the scene that the window showed before; the workbench's own if it showed that already.
    """
    _listeners.append(listener)


def remove_listener(listener: Callable[[bpy.types.Window, bpy.types.Scene], None]) -> None:
    """Stop calling a listener."""
    _listeners.remove(listener)


def is_workbench(scene: bpy.types.Scene) -> bool:
    """Whether a scene is the add-on's own, or holds an alignment of a version that used the user's scene."""
    settings = scene.oneframe
    return MARK in scene or settings.camera_object is not None or settings.surface is not None


def existing() -> bpy.types.Scene | None:
    """The workbench's scene in this file; ``None`` if there is none."""
    return next((scene for scene in bpy.data.scenes if scene.library is None and is_workbench(scene)), None)


def enter(context: bpy.types.Context) -> bpy.types.Scene:
    """Show the workbench's scene in the context's window, and return it; it is made if the file has none.

    Values typed into the panel before, such as K, come along.
    """
    left, window = context.scene, context.window or context.window_manager.windows[0]
    scene = left if is_workbench(left) else existing()
    if scene is None:
        scene = bpy.data.scenes.new(NAME)
        scene[MARK] = True
        _copy_typed(left.oneframe, scene.oneframe)
    if scene != left:
        window.scene = scene
    for listener in _listeners:
        listener(window, left)
    return scene


def _copy_typed(source: bpy.types.PropertyGroup, target: bpy.types.PropertyGroup) -> None:
    """Copy the values that were set, but neither data-blocks nor lists."""
    for declared in source.bl_rna.properties:
        name = declared.identifier
        if name in ("rna_type", "name"):
            continue
        value = getattr(source, name)
        if isinstance(value, bpy.types.PropertyGroup):
            _copy_typed(value, getattr(target, name))
        elif declared.type not in ("POINTER", "COLLECTION") and source.is_property_set(name):
            setattr(target, name, value)
