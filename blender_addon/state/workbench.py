"""The scene in which the add-on works: its own, so that nothing in the user's scenes changes.

Opening a case, or loading the first frame, K or surface, makes the scene and shows it in the window. The window's
interface follows: ``view.workspace`` is one of the :data:`entered_handlers`.
"""

from collections.abc import Callable

import bpy
from bpy.app.handlers import persistent

from ..class_registration import listening
from . import from_scene

NAME = "OneFrame"
MARK = "oneframe_workbench"
"""Custom property of the add-on's scene."""

entered_handlers: list[Callable[[bpy.types.Window, bpy.types.Scene], None]] = []
"""Called with the window, and the scene that it showed before, when the add-on sets something up; that scene is the
workbench's own if the window showed it already."""

OPEN = "Open a case, which can also be dropped onto the view, or load frame, K and surface in any order."

MAKE_SURFACE = "Next: set the threshold in the panel CT, and press Make Surface."


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
    for handler in entered_handlers:
        handler(window, left)
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


def next_step(scene: bpy.types.Scene) -> str:
    """What the user does next, in one sentence; empty once all is there, and of this frame."""
    settings = scene.oneframe
    has_camera = from_scene.present_camera(scene) is not None
    has_surface = from_scene.present_surface(scene) is not None
    if not (settings.frame_path or has_camera or has_surface):
        return MAKE_SURFACE if scene.oneframe_ct.path else OPEN
    if not settings.frame_path:
        return "Next: load the frame, one image of the microscope."
    if not has_camera:
        return "Next: load K from a file, or type it under Camera K and press Set Camera."
    if not has_surface:
        return "Next: load the surface, or make it from the CT."
    return ""


@persistent
def _place_objects(*_arguments: object) -> None:
    """Give the objects their places: undo and files leave them in the origin until Blender draws the scene.

    Handlers and timers, such as the autosave, read the pose before; and another scene may be shown.
    """
    scene = existing()
    for layer in scene.view_layers if scene is not None else ():
        layer.update()


PARTS = (
    listening(bpy.app.handlers.undo_post, _place_objects),
    listening(bpy.app.handlers.redo_post, _place_objects),
    listening(bpy.app.handlers.load_post, _place_objects),
)
