"""Double precision on Blender data: float64 arrays kept as text in custom properties.

Blender's own numbers are single precision. What a file gave is kept here beside them, so that a case that is opened and
saved comes back bit by bit, and a pose does not drift however often it is read back.
"""

import json

import bpy
import numpy as np
from numpy.typing import ArrayLike


def set_exact(data: bpy.types.ID, name: str, values: ArrayLike) -> None:
    """Store a float64 array of any shape in a custom property of a data-block."""
    # repr of a Python float is the shortest text that reads back to the same number
    data[name] = json.dumps(np.asarray(values, dtype=np.float64).tolist())


def exact(data: bpy.types.ID, name: str) -> np.ndarray | None:
    """The array that :func:`set_exact` stored, or ``None`` if there is none (or someone has overwritten it)."""
    text = data.get(name)
    if not isinstance(text, str):
        return None
    try:
        return np.array(json.loads(text), dtype=np.float64)
    except (ValueError, TypeError):
        return None
