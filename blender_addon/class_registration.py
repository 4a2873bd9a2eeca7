"""Classes for Blender, with properties whose types a type checker can read.

Blender takes a property from an annotation, ``width: IntProperty(min=1)``, which is no type. The add-on's classes write
``width: int = prop(IntProperty(min=1))`` instead; registration makes the annotations that Blender expects of it.
"""

import inspect
from collections.abc import Callable, Sequence
from typing import Any, Protocol

import bpy

_Definition = type(bpy.props.BoolProperty())


def prop(definition: object) -> Any:
    """A property of Blender (``bpy.props``) as the value of a class attribute, which is annotated with its type."""
    return definition


class Registered(Protocol):
    """What an add-on registers beside its classes."""

    def register(self) -> None:
        """Called after the classes are registered."""

    def unregister(self) -> None:
        """Called before the classes are unregistered."""


class Handlers:
    """Functions that Blender calls at its events: :meth:`register` adds them, :meth:`unregister` removes them."""

    def __init__(self, *pairs: tuple[list[Any], Callable[..., None]]) -> None:
        """Take lists of ``bpy.app.handlers``, each with a function for it."""
        self._pairs = pairs

    def register(self) -> None:
        """Add the functions."""
        for handlers, handler in self._pairs:
            handlers.append(handler)

    def unregister(self) -> None:
        """Remove the functions."""
        for handlers, handler in self._pairs:
            handlers.remove(handler)


def class_registration(
    classes: Sequence[type], keys: Registered | None = None
) -> tuple[Callable[[], None], Callable[[], None]]:
    """Functions that register classes and their keys, and unregister them in the opposite order.

    Parameters
    ----------
    classes
        Operators, panels, property groups and so on, each after those that it refers to. Their properties, and those
        of the mixins that they inherit from, are written as above.
    keys
        The keys of these operators (``ui.keymap.Keys``).
    """
    for kind in classes:
        for base in kind.__mro__:
            definitions = {name: value for name, value in vars(base).items() if isinstance(value, _Definition)}
            for name in definitions:
                delattr(base, name)
            if definitions:
                base.__annotations__ = {**inspect.get_annotations(base), **definitions}
    register_classes, unregister_classes = bpy.utils.register_classes_factory(classes)
    if keys is None:
        return register_classes, unregister_classes

    def register() -> None:
        register_classes()
        keys.register()

    def unregister() -> None:
        keys.unregister()
        unregister_classes()

    return register, unregister
