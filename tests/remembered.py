"""What slow functions without side effects have returned: tests that ask the same need it worked out once."""

from collections.abc import Callable, Hashable
from functools import wraps
from typing import Any

import numpy as np


def remembered(function: Callable[..., Any], key: Callable[..., Hashable]) -> Callable[..., Any]:
    """The function, called once for all arguments of which ``key`` says the same."""
    found: dict[Hashable, Any] = {}

    @wraps(function)
    def once(*arguments: Any, **named: Any) -> Any:
        asked = key(*arguments, **named)
        if asked not in found:
            found[asked] = function(*arguments, **named)
        return found[asked]

    return once


def refinement(decimals: int = 15) -> Callable[..., Hashable]:
    """Key of :func:`refine_pose`, for poses that are the same to these decimals."""

    def key(image, valid, camera, mesh, start, *, colours=None, progress=None) -> Hashable:
        arrays = image, valid, mesh.vertices, start.round(decimals) + 0.0, np.zeros(0) if colours is None else colours
        return camera, *(array.tobytes() for array in arrays)

    return key


def registration(registrar, grey, valid, near=None, guesses=()) -> Hashable:
    """Key of :meth:`Registrar.register`: the aligned frame, the frame, the pose that may be near, and who guesses."""
    source = registrar._views.source
    arrays = registrar._pivot_model, source.image, source.cam_from_model, grey, valid
    return registrar.camera, guesses, *(array.tobytes() for array in arrays), None if near is None else near.tobytes()
