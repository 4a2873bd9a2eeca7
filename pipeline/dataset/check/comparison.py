"""Comparing what a file holds with what it should: exact for values, within rounding for numbers computed again."""

import csv
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from ...errors import InputError
from ...files.content import read_content, reading
from ...files.tables import parsed_json

RELATIVE = 1e-9
"""Allowed relative error of a number that is computed again."""
WHOLE = "the entry"


def read_table(root: Path, name: str) -> Any:
    """The value in a JSON file of the dataset.

    Raises
    ------
    InputError
        Missing or damaged.
    """
    return parsed_json(read_content(root / name, "a table of the dataset", name), name)


def read_rows(root: Path, name: str, header: list[str]) -> Iterator[list[str]]:
    """The rows of a CSV table of the dataset, one after the other, which must have these columns.

    Raises
    ------
    InputError
        Missing or damaged, or with other columns.
    """
    with (
        reading(root / name, "a table of the dataset", name),
        (root / name).open(encoding="utf-8", newline="") as file,
    ):
        try:
            for number, row in enumerate(csv.reader(file, strict=True)):
                if number and len(row) != len(header):
                    raise InputError(f"{name}: row {number - 1}: expected {len(header)} cells, found {len(row)}")
                if number:
                    yield row
                elif row != header:
                    raise InputError(f"{name}: expected the columns {', '.join(header)}, found {shortened(row)}")
        except (csv.Error, UnicodeDecodeError) as error:
            raise InputError(f"{name}: expected a CSV table, found a damaged file ({error})") from None


def numbers_of(cells: list[str], where: str) -> list[float]:
    """The numbers in cells of a table; InputError if one holds something else."""
    try:
        return [float(cell) for cell in cells]
    except ValueError as error:
        raise InputError(f"{where}: expected numbers, found another cell ({error})") from None


def require_equal(found: object, expected: object, where: str, *, relative: float = 0.0) -> None:
    """Check that two JSON values are the same, all keys included.

    Numbers may differ by ``relative`` of the largest in their list, of lists and of 1.

    Raises
    ------
    InputError
        They are not; with the first difference.
    """
    difference = _difference(found, expected, WHOLE, relative)
    if difference:
        raise InputError(f"{where}: {difference}")


def require_pose(found: np.ndarray, expected: np.ndarray, where: str, see: str) -> None:
    """Check that two 4x4 poses are the same within rounding; InputError if not."""
    for name, part in (("rotation", np.s_[:3, :3]), ("translation", np.s_[:3, 3])):
        off = np.abs(found[part] - expected[part]).max()
        if not off <= RELATIVE * max(np.abs(expected[part]).max(), 1.0):
            raise InputError(f"{where}: the {name} differs from that of {see} by {off:.2g}")


def require_rotation(pose: np.ndarray, where: str) -> None:
    """Check that the rotation of a 4x4 pose is orthonormal with determinant 1; InputError if not."""
    rotation = pose[:3, :3]
    off = float(np.abs(rotation @ rotation.T - np.eye(3)).max())
    if not off <= RELATIVE or np.linalg.det(rotation) < 0:
        determinant = np.linalg.det(rotation)
        raise InputError(
            f"{where}: expected a rotation, found a matrix off by {off:.2g} with determinant {determinant:.6g}"
        )


def shortened(value: object) -> str:
    """A value as JSON of at most 60 characters, for messages."""
    text = json.dumps(value, default=str)
    return text if len(text) <= 60 else text[:57] + "..."


def _difference(found: object, expected: object, name: str, relative: float) -> str:
    """The first difference of two JSON values, as a clause; empty if there is none."""
    if found == expected:
        return ""
    if isinstance(found, dict) and isinstance(expected, dict):
        place = "" if name == WHOLE else f"{name}."
        missing, unknown = expected.keys() - found.keys(), found.keys() - expected.keys()
        if missing or unknown:
            keys = sorted(map(str, missing or unknown))
            what = "missing" if missing else "unknown"
            return f"{name}: expected {len(expected)} keys, {len(keys)} are {what} ({', '.join(keys[:3])})"
        parts = (_difference(found[key], expected[key], f"{place}{key}", relative) for key in expected)
        return next(filter(None, parts), "")
    if relative and _is_near(found, expected, relative):
        return ""
    if isinstance(found, list) and isinstance(expected, list) and len(found) == len(expected):
        for number, (one, other) in enumerate(zip(found, expected, strict=True)):
            # numbers were compared with the largest of their list
            near = relative if isinstance(other, dict | list) else 0.0
            if difference := _difference(one, other, f"{name}[{number}]" if len(found) > 1 else name, near):
                return difference
        return ""
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
