"""Numbers in text files: parsed at the speed of C, and strict about separators."""

import io
import math
import operator
import re
import sys
import warnings
from decimal import Decimal, DecimalException
from typing import Any

import numpy as np

from ..errors import InputError

_BLOCK, _SPACE = 64 << 10, re.compile(rb"\s")
MM_PER_UNIT = {"mm": 1.0, "m": 1000.0}


MOST_DIGITS = 100
"""Longest number whose digits are remembered; 17 determine a float."""


class WrittenFloat(float):
    """A number of a text file that remembers its digits: the ``parse_float`` of :mod:`tomllib` and :mod:`json`."""

    digits: str

    def __new__(cls, digits: str) -> "WrittenFloat":
        number = super().__new__(cls, digits)
        # no length in a file needs more, and arithmetic with a million digits takes long
        number.digits = digits if len(digits) <= MOST_DIGITS else repr(float(number))
        return number


def millimetres(value: float, mm_per_unit: float) -> float:
    """Convert a length from a file's unit to mm; rounded once from the decimal digits where these are known."""
    if mm_per_unit == 1:
        return float(value)
    try:
        written = Decimal(value.digits if isinstance(value, WrittenFloat) else repr(float(value)))
        return float(written * Decimal(mm_per_unit))
    except DecimalException:  # an exponent that Decimal does not hold
        return float(value) * mm_per_unit


def length_text(value_mm: float, mm_per_unit: float) -> str:
    """The number to write for a length in mm; :func:`millimetres` reads it back to the last bit."""
    if mm_per_unit == 1:
        return repr(float(value_mm))
    shortest = repr(float(value_mm) / mm_per_unit)
    if millimetres(float(shortest), mm_per_unit) == value_mm:
        return shortest
    return str(Decimal(repr(float(value_mm))) / Decimal(mm_per_unit))


def is_number(value: object) -> bool:
    """Whether it is a finite real number, and no truth value."""
    return isinstance(value, int | float) and not isinstance(value, bool) and abs(value) <= sys.float_info.max


def parsed_numbers(text: bytes, dtype: type[np.float64] | type[np.int64]) -> np.ndarray | None:
    """``(N,)`` numbers separated by white space; ``None`` if the text holds anything else."""
    text = text.strip()
    if not text:
        return np.empty(0, dtype)
    if dtype is np.int64 and re.search(rb"[+-](?![0-9])", text):
        return None  # C's strtol reads "- 3" as one number
    with warnings.catch_warnings():
        warnings.simplefilter("error", DeprecationWarning)  # numpy 1.26 only warns where numpy 2 raises
        try:
            return np.fromstring(text, dtype, sep=" ")
        except (ValueError, DeprecationWarning):
            return None


def first_wrong_word(text: bytes, dtype: type[np.float64] | type[np.int64]) -> tuple[int, str]:
    """Where :func:`parsed_numbers` failed: index of the line (from 0) and the word. Slow, for messages only."""
    start, lines = 0, 0
    while start < len(text):
        # blocks of whole words, at the speed of C up to the one with the mistake
        space = _SPACE.search(text, start + _BLOCK)
        stop = space.end() if space else len(text)
        if parsed_numbers(text[start:stop], dtype) is None:
            break
        lines += text.count(b"\n", start, stop)
        start = stop
    block = text[start:stop] if start < len(text) else b""
    for match in re.finditer(rb"\S+", block):
        if parsed_numbers(match[0], dtype) is None:
            return lines + block.count(b"\n", 0, match.start()), match[0][:30].decode("latin-1")
    return 0, "something else"


def unfinished_warnings(data: bytes, where: str) -> list[str]:
    """A warning if a text file does not end with a line break, else nothing.

    Many writers leave it out. But a file that was cut off inside its last number still parses, and the missing line
    break is the only sign of it.
    """
    if data.endswith((b"\n", b"\r")):
        return []
    return [f"{where}: the last line has no line break; if the file was cut off there, its last number is wrong"]


def npy_array(data: bytes, where: str) -> np.ndarray:
    """The array of an ``.npy`` file: a read-only view of its bytes, which are never unpickled."""
    stream = io.BytesIO(data)
    try:
        # version 3.0 only adds Unicode field names, which plain numbers do not have
        read_header = _NPY_HEADERS[np.lib.format.read_magic(stream)]
        shape, columns_first, dtype = read_header(stream)
        if dtype.hasobject:
            raise ValueError("it holds objects")
        count = math.prod(shape) if min(shape, default=0) >= 0 else len(data)
        # a view of the bytes takes no memory, whatever size a damaged header claims
        array = np.frombuffer(data, dtype, count, stream.tell()).reshape(shape, order="F" if columns_first else "C")
    except Exception as error:  # the header is a Python literal: a damaged one may raise anything
        raise InputError(
            f"{where}: expected an array of numbers, cannot read it ({error}); "
            "pickled objects are never loaded: save floats with numpy.save"
        ) from None
    if array.dtype.kind not in "fiu":
        raise InputError(f"{where}: expected an array of real numbers, found type {array.dtype}; save it as floats")
    return array


_NPY_HEADERS = {(1, 0): np.lib.format.read_array_header_1_0, (2, 0): np.lib.format.read_array_header_2_0}


def number_rows(text: str) -> np.ndarray | None:
    """``(N,)`` numbers of a text, ignoring comments, commas and brackets; ``None`` if it holds anything else."""
    text = re.sub(r"(#|//|%).*", "", text)
    return parsed_numbers(re.sub(r"[\[\](){},;]", " ", text).encode(), np.float64)


def format_two_digits(value: float) -> str:
    """Two significant digits, without an exponent for large numbers: 0.034, 1.2, 120."""
    return f"{value:.2g}" if abs(value) < 99.5 else f"{value:.0f}"


def whole_number(value: Any, most: int) -> int:
    """A whole number from 0 to ``most``; raises TypeError or ValueError for something else."""
    if not 0 <= operator.index(value) <= most:
        raise ValueError(f"expected at most {most}, found {str(value)[:60]}")
    return int(value)
