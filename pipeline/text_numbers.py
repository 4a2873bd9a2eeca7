"""Numbers in text files: parsed at the speed of C, and strict about what stands between them."""

import re
import warnings

import numpy as np


def parsed_numbers(text: bytes, dtype: type[np.float64] | type[np.int64]) -> np.ndarray | None:
    """``(N,)`` numbers separated by white space; ``None`` if anything else stands in the text."""
    text = text.strip()
    if not text:
        return np.empty(0, dtype)
    if dtype is np.int64 and re.search(rb"[+-](?![0-9])", text):
        return None  # C's strtol takes "- 3" as one number
    with warnings.catch_warnings():
        warnings.simplefilter("error", DeprecationWarning)  # how numpy 1.26 tells what numpy 2 raises
        try:
            return np.fromstring(text, dtype, sep=" ")
        except (ValueError, DeprecationWarning):
            return None


def first_wrong_word(text: bytes, dtype: type[np.float64] | type[np.int64]) -> tuple[int, str]:
    """Where :func:`parsed_numbers` failed: index of the line (from 0), and the word; slow, for messages only."""
    for index, line in enumerate(text.splitlines()):
        for word in line.split():
            if parsed_numbers(word, dtype) is None:
                return index, word[:30].decode("latin-1")
    return 0, "something else"


def told_if_unfinished(data: bytes, where: str) -> list[str]:
    """A sentence for the user if a text file does not end with a line break.

    Many writers leave it out. But a file that was cut inside its last number is still valid, and this is its only mark.
    """
    if data.endswith((b"\n", b"\r")):
        return []
    return [f"{where}: the last line has no line break; if the file was cut off there, its last number is wrong"]
