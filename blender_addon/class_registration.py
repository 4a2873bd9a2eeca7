"""What a module of the add-on places in Blender while it is enabled: classes, properties, handlers, drawing, timers.

Blender takes a property from an annotation, ``width: IntProperty(min=1)``, which is no type. The add-on's classes write
``width: int = prop(IntProperty, min=1)`` instead; registration makes the annotations that Blender expects of it.
What else a module places is in its ``PARTS``.
"""

import inspect
from collections.abc import Callable
from types import ModuleType
from typing import Any, NamedTuple

import bpy

_Definition = type(bpy.props.BoolProperty())


def prop(kind: Callable[..., object], name: str = "", description: str = "", **settings: Any) -> Any:
    """A property of Blender (``bpy.props``) as the value of a class attribute, which is annotated with its type."""
    # without a name, Blender takes that of the attribute
    return kind(description=description, **({"name": name} if name else {}), **settings)


class Part(NamedTuple):
    """What a module places in Blender, and how it takes it back."""

    register: Callable[[], object]
    unregister: Callable[[], object]


def attached(owner: type, name: str, group: type[bpy.types.PropertyGroup]) -> Part:
    """A group of properties of all data-blocks of a type."""
    return Part(lambda: setattr(owner, name, bpy.props.PointerProperty(type=group)), lambda: delattr(owner, name))


def listening(listeners: list[Any], function: Callable[..., object]) -> Part:
    """A function in a list of ``bpy.app.handlers``, or in one of the add-on's own."""
    return Part(lambda: listeners.append(function), lambda: listeners.remove(function))


def tool(kind: type[bpy.types.WorkSpaceTool], after: str, *, separator: bool = False) -> Part:
    """A tool in the toolbar."""
    return Part(
        lambda: bpy.utils.register_tool(kind, after={after}, separator=separator),
        lambda: bpy.utils.unregister_tool(kind),
    )


def drawing(space: type[bpy.types.Space], draw: Callable[[], None], place: str) -> Part:
    """A function that draws in all editors of a kind, ``POST_VIEW`` or ``POST_PIXEL``."""
    handles: list[Any] = []
    return Part(
        lambda: handles.append(space.draw_handler_add(draw, (), "WINDOW", place)),  # type: ignore[attr-defined]
        lambda: space.draw_handler_remove(handles.pop(), "WINDOW"),  # type: ignore[attr-defined]
    )


def cursor(draw: Callable[[tuple[int, int]], None]) -> Part:
    """A function that draws at the pointer (window px) over 3D views; Blender calls it whenever that moves."""
    handles: list[Any] = []
    return Part(
        lambda: handles.append(bpy.types.WindowManager.draw_cursor_add(draw, (), "VIEW_3D", "WINDOW")),
        lambda: bpy.types.WindowManager.draw_cursor_remove(handles.pop()),
    )


def start_timer(timer: Callable[[], float | None], seconds: float) -> None:
    """Call a function after so many seconds, unless it waits already."""
    if not bpy.app.timers.is_registered(timer):
        bpy.app.timers.register(timer, first_interval=seconds)


def timers(*functions: Callable[[], float | None]) -> Part:
    """Timers that the module starts by itself: none goes on without it."""

    def stop() -> None:
        for timer in filter(bpy.app.timers.is_registered, functions):
            bpy.app.timers.unregister(timer)

    return at_end(stop)


def at_end(*functions: Callable[[], object]) -> Part:
    """What is left to do when the add-on is disabled: free memory, take pictures away."""
    return Part(lambda: None, lambda: [function() for function in functions])


def registration(module: ModuleType) -> Part:
    """What registers a module: its classes, and the parts in its ``PARTS``, in order; and back in the opposite order.

    Its classes ``ONEFRAME_...`` are operators, panels, property groups and so on, each after those that it refers to.
    Their properties, and those of the mixins that they inherit from, are written as above. The name of a class says how
    Blender calls it: ``ONEFRAME_OT_open_case`` is the operator ``oneframe.open_case``.
    """
    found = [kind for kind in vars(module).values() if isinstance(kind, type)]
    classes = [kind for kind in found if kind.__module__ == module.__name__ and kind.__name__.startswith("ONEFRAME_")]
    for kind in classes:
        if issubclass(kind, bpy.types.Operator):
            kind.bl_idname = kind.__name__.replace("ONEFRAME_OT_", "oneframe.")
        for base in kind.__mro__:
            definitions = {name: value for name, value in vars(base).items() if isinstance(value, _Definition)}
            for name in definitions:
                delattr(base, name)
            if definitions:
                base.__annotations__ = {**inspect.get_annotations(base), **definitions}
    parts: tuple[Part, ...] = (Part(*bpy.utils.register_classes_factory(classes)), *getattr(module, "PARTS", ()))
    return Part(lambda: [part.register() for part in parts], lambda: [part.unregister() for part in reversed(parts)])
