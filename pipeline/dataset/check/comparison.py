"""Comparing what a file holds with what it should: exact for values, within rounding for numbers computed again."""

import json
from pathlib import Path
from typing import Any

import numpy as np

from ...errors import InputError
from ...files.content import read_content
from ...files.tables import parsed_json

RELATIVE = 1e-9
"""Allowed relative error of a number that is computed again."""


def read_table(root: Path, name: str) -> Any:
    """The value in a JSON file of the dataset.

    Raises
    ------
    InputError
        Missing or damaged.
    """
    return parsed_json(read_content(root / name, "a table of the dataset", name), name)


def require_equal(found: object, expected: object, where: str, *, relative: float = 0.0) -> None:
    """Check that two JSON values are the same, all keys included.

    Numbers may differ by ``relative`` of the largest in their list, of lists and of 1.

    Raises
    ------
    InputError
        They are not; with the first difference.
    """
    difference = _difference(found, expected, "the entry", relative)
    if difference:
        raise InputError(f"{where}: {difference}")


def require_pose(found: np.ndarray, expected: np.ndarray, where: str, see: str) -> None:
    """Check that two 4x4 poses are the same within rounding; InputError if not."""
    for name, part in (("rotation", np.s_[:3, :3]), ("translation", np.s_[:3, 3])):
        off = np.abs(found[part] - expected[part]).max()
        if not off <= RELATIVE * max(np.abs(expected[part]).max(), 1.0):
            raise InputError(f"{where}: the {name} differs from that of {see} by {off:.2g}")


def shortened(value: object) -> str:
    """A value as JSON of at most 60 characters, for messages."""
    text = json.dumps(value, default=str)
    return text if len(text) <= 60 else text[:57] + "..."


def _difference(found: object, expected: object, name: str, relative: float) -> str:
    """The first difference of two JSON values, as a clause; empty if there is none."""
    if found == expected:
        return ""
    if isinstance(found, dict) and isinstance(expected, dict):
        missing, unknown = expected.keys() - found.keys(), found.keys() - expected.keys()
        if missing or unknown:
            keys = sorted(map(str, missing or unknown))
            what = "missing" if missing else "unknown"
            return f"{name}: expected {len(expected)} keys, {len(keys)} are {what} ({', '.join(keys[:3])})"
        parts = (_difference(found[key], expected[key], key, relative) for key in expected)
        return next(filter(None, parts), "")
    if relative and _is_near(found, expected, relative):
        return ""
    if isinstance(found, list) and isinstance(expected, list) and len(found) == len(expected):
        for number, pair in enumerate(zip(found, expected, strict=True)):
            if pair[0] != pair[1]:
                return _difference(*pair, f"{name}[{number}]" if len(found) > 1 else name, 0.0)
    return f"{name} is {shortened(found)}, expected {shortened(expected)}"


def _is_near(found: object, expected: object, relative: float) -> bool:
    """Whether two numbers or lists of numbers are the same within rounding."""
    try:
        one, other = np.asarray(found), np.asarray(expected)
    except ValueError:  # lists of several lengths
        return False
    if one.shape != other.shape or one.dtype.kind not in "if" or other.dtype.kind not in "if":
        return False
    return bool((np.abs(one - other) <= relative * max(np.abs(other).max(initial=0), 1.0)).all())
