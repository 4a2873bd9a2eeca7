"""Registers classes with Blender whose properties have types that a type checker can read.

Blender takes a property from an annotation, ``width: IntProperty(min=1)``, which is not a type. The add-on's classes
write ``width: Annotated[int, IntProperty(min=1)]`` instead: first the type of the value, then Blender's definition.
"""

import inspect
from collections.abc import Callable, Sequence
from typing import Annotated, get_args, get_origin

import bpy


def class_registration(classes: Sequence[type]) -> tuple[Callable[[], None], Callable[[], None]]:
    """Return functions that register classes, and unregister them in reverse order.

    Parameters
    ----------
    classes
        Operators, panels, property groups and so on, each after the classes that it refers to. Their properties, and
        those of the mixins that they inherit from, may be annotated as above.
    """
    for kind in classes:
        for base in kind.__mro__:
            # from Python 3.14 on, a class computes its annotations on demand: they must be read and set explicitly
            annotations = inspect.get_annotations(base)
            if any(get_origin(annotation) is Annotated for annotation in annotations.values()):
                base.__annotations__ = {name: _definition(annotation) for name, annotation in annotations.items()}
    register, unregister = bpy.utils.register_classes_factory(classes)
    return register, unregister


def _definition(annotation: object) -> object:
    return get_args(annotation)[1] if get_origin(annotation) is Annotated else annotation
