"""Classes for Blender, with properties whose types a type checker can read.

Blender takes a property from an annotation, ``width: IntProperty(min=1)``, which is no type. The add-on's classes write
``width: Annotated[int, {IntProperty(min=1)}]`` instead: the type of the value, then Blender's definition in a
set: that has no hash, or ``typing`` would remember it and keep the add-on in memory after it has been removed.
"""

import inspect
from collections.abc import Callable, Sequence
from typing import Annotated, get_args, get_origin

import bpy


def class_registration(classes: Sequence[type]) -> tuple[Callable[[], None], Callable[[], None]]:
    """Functions that register classes, and unregister them in the opposite order.

    Parameters
    ----------
    classes
        Operators, panels, property groups and so on, each after those that it refers to. Their properties, and those
        of the mixins that they inherit from, may be annotated as above.
    """
    for kind in classes:
        for base in kind.__mro__:
            # not as an attribute, which may be a base's; from Python 3.14 on they are made when they are asked for
            annotations = inspect.get_annotations(base)
            if any(get_origin(annotation) is Annotated for annotation in annotations.values()):
                base.__annotations__ = {name: _definition(annotation) for name, annotation in annotations.items()}
    register, unregister = bpy.utils.register_classes_factory(classes)
    return register, unregister


def _definition(annotation: object) -> object:
    """Blender's definition of a property; any other annotation as it is."""
    if get_origin(annotation) is not Annotated:
        return annotation
    (definition,) = get_args(annotation)[1]
    return definition
