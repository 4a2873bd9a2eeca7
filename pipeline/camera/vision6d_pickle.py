"""Vision6D's camera file: a pickle of ``{camera_intrinsics, canvas_height, canvas_width}``, read without running it."""

import io
import pickle
from typing import Any

import numpy as np

from ..errors import InputError

LARGEST_FILE = 1 << 16
"""Bytes; the real ones have some hundred."""

_ARRAY, _SCALAR = np.zeros(1), np.float64()
_MAKERS: tuple[Any, ...] = (
    np.ndarray,
    np.dtype,
    _ARRAY.__reduce__()[0],
    _ARRAY.__reduce_ex__(5)[0],
    _SCALAR.__reduce__()[0],
)
"""All that numpy's arrays and numbers are unpickled by."""


# in Python: the one in C makes room for any number that a damaged file has in the place of a small one
class _NumbersUnpickler(pickle._Unpickler):  # type: ignore[name-defined, misc]
    def find_class(self, module: str, name: str) -> object:
        for maker in _MAKERS:
            # numpy._core is numpy.core in numpy 1
            if name == maker.__name__ and module.partition(".")[0] == "numpy":
                return maker
        if (module, name) == ("_codecs", "encode"):  # how protocols below 3 keep bytes
            return super().find_class(module, name)
        raise InputError(
            f"expected numbers only, found the name {module}.{name}, which would run code; the file was not opened "
            "further: ask whoever made it for K as text"
        )


def camera_table(data: bytes, where: str) -> dict[str, object]:
    """The dictionary in a pickled camera, with arrays as nested lists.

    Raises
    ------
    InputError
        A pickle that names anything but numpy's arrays, damaged or too long, or one that is no dictionary.
    """
    if len(data) > LARGEST_FILE:
        raise InputError(f"{where}: expected a camera, found a pickle of {len(data):,} bytes")
    try:
        found = _NumbersUnpickler(io.BytesIO(data)).load()
    except InputError as error:
        raise InputError(f"{where}: {error}") from None
    except Exception as error:  # a damaged pickle may raise any
        raise InputError(f"{where}: expected a pickled camera, cannot read it ({error}); export it again") from None
    if not isinstance(found, dict):
        raise InputError(f"{where}: expected a dictionary with camera_intrinsics, found {type(found).__name__}")
    return {key: _plain(value) for key, value in found.items() if isinstance(key, str)}


def _plain(value: object, depth: int = 1) -> object:
    match value:
        case np.ndarray() | np.generic() if value.dtype.kind in "fiu":
            return value.tolist()
        case list() | tuple() if depth < 4:
            return [_plain(part, depth + 1) for part in value]
        case int() if abs(value) < 1 << 63:
            return value
        case float() | str() | None:
            return value
    return f"a {type(value).__name__}"
