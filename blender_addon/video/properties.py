"""What a scene stores of its video: where it is, which part was scored, and the frame that was taken from it."""

import bpy
from bpy.props import BoolProperty, FloatProperty, IntProperty, PointerProperty, StringProperty

from ..registration import class_registration, prop
from ..ui.operator import redraw


def _redraw(_owner: object, context: bpy.types.Context) -> None:
    redraw(context)


class ONEFRAME_PG_video(bpy.types.PropertyGroup):
    """The video of a scene."""

    path: str = prop(StringProperty(name="Video", description="The film of the microscope", subtype="FILE_PATH"))
    every: int = prop(IntProperty(name="Every", description="Only every so many frames were scored", default=1, min=1))
    from_s: float = prop(FloatProperty(name="From (s)", description="Where the scored part begins", min=0))
    to_s: float = prop(FloatProperty(name="To (s)", description="Where it ends; 0 for the end of the film", min=0))
    visible: bool = prop(
        BoolProperty(name="Strip", description="The strip is shown", default=True, update=_redraw, options={"HIDDEN"})
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
