"""Matrices in files of numbers: ``.npy``, and text with rows of numbers, as ``numpy.savetxt`` or a print gives it."""

import io
import re
from pathlib import Path

import numpy as np

from .errors import InputError
from .text_numbers import parsed_numbers

LARGEST_FILE = 64 << 20
"""Bytes: what is longer is another file, chosen by mistake."""


def file_content(path: Path, what: str) -> bytes:
    """The bytes of a file that should hold ``what``, such as ``"a camera"``.

    Raises
    ------
    InputError
        Missing, a folder, unreadable, empty, or longer than :data:`LARGEST_FILE`.
    """
    try:
        size = path.stat().st_size
        if size > LARGEST_FILE:
            raise InputError(f"{path.name}: expected a file with {what}, found one of {size >> 20} MB; choose another")
        data = path.read_bytes()
    except FileNotFoundError:
        raise InputError(f"{path}: expected a file with {what}, it does not exist; correct the path") from None
    except OSError as error:
        raise InputError(f"{path}: expected a file with {what}, cannot read it ({error.strerror})") from None
    if not data:
        raise InputError(f"{path.name}: expected a file with {what}, found an empty one; copy it again")
    return data


def decoded(data: bytes) -> str | None:
    """The text of a text file in Unicode, or ``None``."""
    encoding = "utf-16" if data.startswith((b"\xff\xfe", b"\xfe\xff")) else "utf-8-sig"
    try:
        text = data.decode(encoding)
    except UnicodeDecodeError:
        return None
    return None if "\0" in text else text


def npy_array(data: bytes, where: str) -> np.ndarray:
    """The array of an ``.npy`` file, which is never unpickled.

    Raises
    ------
    InputError
        Damaged, or not of numbers.
    """
    try:
        array = np.load(io.BytesIO(data), allow_pickle=False)
    except Exception as error:  # the header is Python, so that a damaged one raises anything
        raise InputError(f"{where}: expected an array of numbers, cannot read it ({error}); save it again") from None
    if array.dtype.kind not in "fiu":
        raise InputError(f"{where}: expected an array of numbers, found one of type {array.dtype}")
    return array


def number_rows(text: str) -> np.ndarray | None:
    """``(N,)`` numbers of a text of numbers, with commas and brackets or without; ``None`` if it is another text."""
    text = re.sub(r"(#|//|%).*", "", text)
    return parsed_numbers(re.sub(r"[\[\](){},;]", " ", text).encode(), np.float64)
