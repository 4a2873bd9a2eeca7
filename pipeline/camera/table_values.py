"""Keys and numbers in the tables that calibration programs write: they spell both in many ways."""

from collections.abc import Mapping
from typing import Any

from ..files.numbers import number_rows

MOST_NUMBERS = 100
"""Numbers of a list; no K, size or distortion has more."""

LONGEST_NAME = 60
"""Characters of a key or a model's name that messages show."""


def plain_key(key: object) -> str:
    """A key without case, spaces, hyphens and underscores."""
    return str(key).lower().replace("_", "").replace("-", "").replace(" ", "")


def numbers_of(value: Any) -> list[float] | None:
    """The numbers in lists, in OpenCV's ``{rows, cols, data}`` or in a text, flattened; else ``None``."""
    if isinstance(value, Mapping):
        value = value.get("data")
    if isinstance(value, str):
        # ROS writes lists without commas, OpenCV's XML has no lists
        rows = number_rows(value) if any(sign.isdigit() for sign in value) else None
        return None if rows is None or not 1 < len(rows) <= MOST_NUMBERS else rows.tolist()
    if not isinstance(value, list):
        return None
    numbers: list[float] = []
    for part in value:
        number = number_of(part)
        found = [number] if number is not None else numbers_of(part)
        if found is None or len(numbers) + len(found) > MOST_NUMBERS:
            return None
        numbers += found
    return numbers


def number_of(value: Any) -> float | None:
    """A number, also where it is written as text; else ``None``."""
    if isinstance(value, bool) or not isinstance(value, int | float | str):
        return None
    try:
        return float(value)
    except (OverflowError, ValueError):
        return None


def text_of(value: object) -> str:
    """The beginning of a text, or what there is in its place."""
    return value[:LONGEST_NAME] if isinstance(value, str) else f"a {type(value).__name__}"
