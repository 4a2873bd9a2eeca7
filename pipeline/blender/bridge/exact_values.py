"""Double precision on Blender data: float64 arrays in custom properties.

Blender's own numbers have single precision. This module stores the exact values in addition, so that a case is saved
bit by bit as it was opened, and a pose does not drift when it is read back often. Custom properties hold Python's
floats in 64 bits: in memory, in undo steps and in .blend files.
"""

import json

import bpy
import numpy as np
from idprop.types import IDPropertyArray, IDPropertyGroup
from numpy.typing import ArrayLike


def set_exact(data: bpy.types.ID, name: str, values: ArrayLike) -> None:
    """Store a float64 array of any shape in a custom property of a data-block."""
    array = np.asarray(values, dtype=np.float64)
    data[name] = {"shape": list(array.shape), "values": array.ravel().tolist()}


def exact(data: bpy.types.ID, name: str) -> np.ndarray | None:
    """The array that :func:`set_exact` stored, or ``None`` if the property is missing or holds something else."""
    stored = data.get(name)
    if isinstance(stored, str):
        return _from_text(stored)
    if not isinstance(stored, IDPropertyGroup):
        return None
    shape, values = stored.get("shape"), stored.get("values")
    if not _is_array(shape, "i") or not _is_array(values, "d"):
        return None
    try:
        return np.array(values, dtype=np.float64).reshape(tuple(shape))
    except ValueError:
        return None


def _is_array(stored: object, typecode: str) -> bool:
    # an empty array may have any type
    return isinstance(stored, IDPropertyArray) and (stored.typecode == typecode or len(stored) == 0)


def _from_text(text: str) -> np.ndarray | None:
    """Read the JSON of old .blend files, from before 64-bit properties."""
    try:
        return np.array(json.loads(text), dtype=np.float64)
    except (ValueError, TypeError):
        return None
