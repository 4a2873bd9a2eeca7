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


def registration(registrar, frame, near=None) -> Hashable:
    """Key of :meth:`Registrar.find`: the aligned frame, the frame, and the pose that may be near."""
    arrays = registrar.pivot_model, registrar.case_view.image, registrar.cam_from_model, frame.image, frame.valid
    return registrar.camera, *(array.tobytes() for array in arrays), None if near is None else near.tobytes()
