"""What the add-on places in Blender while it is enabled: classes, properties, handlers, tools, timers.

Blender takes a property from an annotation, ``width: IntProperty(min=1)``, which is no type. The add-on's classes write
``width: int = prop(IntProperty, min=1)`` instead; registration makes the annotations that Blender expects of it.
What else a module places is in its ``PARTS``; what it draws is in classes of :mod:`.ui.pane`.
"""

import inspect
from collections.abc import Callable
from importlib import import_module
from pkgutil import iter_modules
from typing import Any, NamedTuple

import bpy

TOPICS = (
    *("state", "ui", "landmarks", "move", "mask", "volume", "view", "setup", "case_queue", "refine", "frames"),
    *("colour", "dataset", "video"),
)
"""Folders of the add-on, in the order of their parts: handlers of the state come first, and of the bindings of a key
Blender tries the one that was added last first."""

_Definition = type(bpy.props.BoolProperty())


def prop(kind: Callable[..., object], name: str = "", description: str = "", **settings: Any) -> Any:
    """A property of Blender (``bpy.props``) as the value of a class attribute, which is annotated with its type."""
    # without a name, Blender takes that of the attribute
    return kind(description=description, **({"name": name} if name else {}), **settings)


class Part(NamedTuple):
    """What a module places in Blender, and how it takes it back."""

    register: Callable[[], object]
    unregister: Callable[[], object]
    is_first: bool = False
    """A tool: Blender makes and removes the keymap in which its keys lie."""


def attached(owner: type, name: str, group: type[bpy.types.PropertyGroup]) -> Part:
    """A group of properties of all data-blocks of a type."""
    return Part(lambda: setattr(owner, name, bpy.props.PointerProperty(type=group)), lambda: delattr(owner, name))


def listening(listeners: Any, function: Callable[..., object]) -> Part:
    """A function in a list of ``bpy.app.handlers``, in one of the add-on's own, or in a menu."""
    return Part(lambda: listeners.append(function), lambda: listeners.remove(function))


def tool(kind: type[bpy.types.WorkSpaceTool], after: str, *, separator: bool = False) -> Part:
    """A tool in the toolbar; a group of its own, as Blender misplaces others, which count its fields as tools."""
    return Part(
        lambda: bpy.utils.register_tool(kind, after={after}, separator=separator, group=True),
        lambda: bpy.utils.unregister_tool(kind),
        is_first=True,
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


def ticking(timer: Callable[[], float], seconds: float) -> Part:
    """A timer that goes on as long as the add-on is enabled, through files that are opened."""
    return Part(
        lambda: bpy.app.timers.register(timer, first_interval=seconds, persistent=True), timers(timer).unregister
    )


def at_end(*functions: Callable[[], object]) -> Part:
    """What is left to do when the add-on is disabled: free memory, take pictures away."""
    return Part(lambda: None, lambda: [function() for function in functions])


def registration(package: str) -> Part:
    """What registers the add-on: all classes of its topics, then the parts in each module's ``PARTS``.

    Classes ``ONEFRAME_...`` are operators, panels, property groups and so on, found in the modules of the folders
    :data:`TOPICS`. Their properties, and those of the mixins that they inherit from, are written as above. The name of
    a class says how Blender calls it: ``ONEFRAME_OT_open_case`` is the operator ``oneframe.open_case``.
    """
    folders = [import_module(f"{package}.{topic}") for topic in TOPICS]
    modules = [
        import_module(f"{each.__name__}.{info.name}") for each in folders for info in iter_modules(each.__path__)
    ]
    classes = {
        name: kind
        for module in modules
        for name, kind in vars(module).items()
        if name.startswith("ONEFRAME_") and isinstance(kind, type) and kind.__module__ == module.__name__
    }
    for kind in classes.values():
        if issubclass(kind, bpy.types.Operator):
            kind.bl_idname = kind.__name__.replace("ONEFRAME_OT_", "oneframe.")
        for base in kind.__mro__:
            definitions = {name: value for name, value in vars(base).items() if isinstance(value, _Definition)}
            for name in definitions:
                delattr(base, name)
            if definitions:
                base.__annotations__ = {**inspect.get_annotations(base), **definitions}
    parts = [Part(*bpy.utils.register_classes_factory(_in_order(classes)))]
    own = [part for module in modules for part in getattr(module, "PARTS", ())]
    parts += sorted(own, key=lambda part: not part.is_first)
    return Part(lambda: [part.register() for part in parts], lambda: [part.unregister() for part in reversed(parts)])


def _in_order(classes: dict[str, type]) -> list[type]:
    """Each class after those that it refers to: the groups that its properties hold, the panel that it is part of."""
    ordered: list[type] = []

    def add(kind: type) -> None:
        held = [value.keywords.get("type") for value in inspect.get_annotations(kind).values() if _is_property(value)]
        for needed in (*held, classes.get(getattr(kind, "bl_parent_id", ""))):
            if needed in classes.values() and needed not in ordered:
                add(needed)
        if kind not in ordered:
            ordered.append(kind)

    for kind in classes.values():
        add(kind)
    return ordered


def _is_property(value: object) -> bool:
    return isinstance(value, _Definition)
