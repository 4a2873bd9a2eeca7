"""Vision6D's camera file: a pickle of ``{camera_intrinsics, canvas_height, canvas_width}``, read without running it.

A pickle is a program. This reader lets it build dictionaries, numbers and texts, and knows the names that numpy's
arrays need, as stand-ins that only keep what they are given; any other name ends the reading.
"""

import io
import pickle
import pickletools
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from ..errors import InputError

LARGEST_FILE = 1 << 20
"""Bytes; the real ones have some hundred."""

MOST_ENTRIES = 16
"""Of a list: a pickle may name one list any number of times, to any depth."""

_ARRAY_TYPE = "numpy.ndarray"


class _Dtype:
    """What a numpy dtype is pickled as."""

    def __init__(self, code: object) -> None:
        self.code = code
        self.order = "<"

    def __setstate__(self, state: tuple) -> None:
        self.order = state[1]

    def real(self) -> np.dtype:
        """Of plain numbers only, or ValueError."""
        if not (isinstance(self.code, str) and self.code[:1] in "fiu" and self.code[1:] in ("1", "2", "4", "8")):
            raise ValueError(f"an array of type {self.code!r}")
        dtype = np.dtype(self.code)
        return dtype.newbyteorder(">") if self.order == ">" else dtype.newbyteorder("<")


class _Array:
    """What a numpy array is pickled as."""

    def __init__(self) -> None:
        self.values: np.ndarray | None = None

    def __setstate__(self, state: tuple) -> None:
        _, shape, dtype, is_fortran, data = state
        self.values = _array(data, dtype, shape, "F" if is_fortran else "C")


def _array(data: object, dtype: object, shape: object, order: object = "C") -> np.ndarray:
    if not isinstance(dtype, _Dtype) or not isinstance(data, bytes | bytearray) or order not in ("C", "F"):
        raise ValueError("an array that is not one of numbers")
    return np.frombuffer(bytes(data), dtype.real()).reshape(shape, order=order)  # type: ignore[call-overload]


def _array_from_buffer(data: object, dtype: object, shape: object, order: object) -> _Array:
    array = _Array()
    array.values = _array(data, dtype, shape, order)
    return array


def _encoded(text: object, encoding: object) -> bytes:
    """How protocols below 3 keep bytes."""
    if not isinstance(text, str) or encoding != "latin1":
        raise ValueError("a text in an unknown encoding")
    return text.encode("latin-1")


class _InertUnpickler(pickle.Unpickler):
    """Knows no name of any module, only stand-ins for numpy's."""

    def find_class(self, module: str, name: str) -> Callable | str:
        # new functions each time: a pickle may set attributes on what it is given
        stand_ins: dict[str, Callable | str] = {
            "ndarray": _ARRAY_TYPE,
            "dtype": lambda code, *_: _Dtype(code),
            "_reconstruct": lambda *_: _Array(),
            "scalar": lambda dtype, data: _array_from_buffer(data, dtype, (), "C"),
            "_frombuffer": lambda *arguments: _array_from_buffer(*arguments),
            "encode": lambda *arguments: _encoded(*arguments),
        }
        # numpy 2 moved its modules from numpy.core to numpy._core
        places = {
            "numpy": ("ndarray", "dtype"),
            "numpy.core.multiarray": ("_reconstruct", "scalar"),
            "numpy.core.numeric": ("_frombuffer",),
            "_codecs": ("encode",),
        }
        if name in places.get(module.replace("numpy._core", "numpy.core"), ()):
            return stand_ins[name]
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
        _check_memory(data)
        found = _plain(_InertUnpickler(io.BytesIO(data)).load())
    except InputError as error:
        raise InputError(f"{where}: {error}") from None
    except Exception as error:  # a damaged pickle may raise any, and its stand-ins have done nothing else
        raise InputError(f"{where}: expected a pickled camera, cannot read it ({error}); export it again") from None
    if not isinstance(found, dict):
        raise InputError(f"{where}: expected a dictionary with camera_intrinsics, found {type(found).__name__}")
    return found


def _check_memory(data: bytes) -> None:
    """Python's reader makes room for any number under which a pickle wants to remember a value."""
    for opcode, argument, _ in pickletools.genops(data):
        if opcode.name in ("PUT", "BINPUT", "LONG_BINPUT") and int(argument or 0) > len(data):
            raise ValueError(f"it remembers a value under number {argument}")


def _plain(value: Any, depth: int = 0) -> object:
    match value:
        case _Array():
            return None if value.values is None else value.values.tolist()
        case Mapping() if depth == 0:
            return {str(key): _plain(part, 1) for key, part in value.items()}
        case list() | tuple() if depth < 4 and len(value) <= MOST_ENTRIES:
            return [_plain(part, depth + 1) for part in value]
        case bool() | int() | float() | str() | None:
            return value
    return f"a {type(value).__name__}"
