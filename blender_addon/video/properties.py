"""What a scene stores of its video: where it is, which part was scored, and the frame that was taken from it."""

from collections.abc import Callable

import bpy
from bpy.props import BoolProperty, FloatProperty, IntProperty, PointerProperty, StringProperty

from ..class_registration import class_registration, prop
from ..ui.operator import redraw

_listeners: list[Callable[[bpy.types.Scene], None]] = []


def _redraw(_owner: object, context: bpy.types.Context) -> None:
    redraw(context)


def _show_again(_owner: object, context: bpy.types.Context) -> None:
    for listener in _listeners:
        listener(context.scene)


def on_look(listener: Callable[[bpy.types.Scene], None]) -> None:
    """Call ``listener(scene)`` when the film is to be shown in another way, until :func:`remove_listener`."""
    _listeners.append(listener)


def remove_listener(listener: Callable[[bpy.types.Scene], None]) -> None:
    """Stop calling a listener."""
    _listeners.remove(listener)


class ONEFRAME_PG_video(bpy.types.PropertyGroup):
    """The video of a scene."""

    path: str = prop(StringProperty(name="Video", description="The film of the microscope", subtype="FILE_PATH"))
    every: int = prop(IntProperty(name="Every", description="Only every so many frames were scored", default=1, min=1))
    from_s: float = prop(FloatProperty(name="From (s)", description="Where the scored part begins", min=0))
    to_s: float = prop(FloatProperty(name="To (s)", description="Where it ends; 0 for the end of the film", min=0))
    visible: bool = prop(
        BoolProperty(name="Strip", description="The strip is shown", default=True, update=_redraw, options={"HIDDEN"})
    )
    show_mask: bool = prop(
        BoolProperty(
            name="Show Mask",
            description="Show in magenta what a masked frame leaves out: instruments, hands, glare, the black around "
            "a circle",
            default=False,
            update=_show_again,
        )
    )
    taken_path: str = prop(
        StringProperty(description="The frame that was taken from the video", subtype="FILE_PATH", options={"HIDDEN"})
    )


_register, _unregister = class_registration((ONEFRAME_PG_video,))


def register() -> None:
    """Add the settings to scenes."""
    _register()
    bpy.types.Scene.oneframe_video = PointerProperty(type=ONEFRAME_PG_video)


def unregister() -> None:
    """Undo :func:`register`."""
    del bpy.types.Scene.oneframe_video
    _unregister()
