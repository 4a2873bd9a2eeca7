"""Comparing what a file holds with what it should: exact for values, within rounding for numbers computed again."""

from pathlib import Path
from typing import Any

import numpy as np

from ...errors import InputError
from ...files.content import read_content
from ...files.tables import parsed_json
from ..identity import changed_values, short

RELATIVE = 1e-9
"""Allowed relative error of a number that is computed again."""


def read_table(root: Path, name: str) -> Any:
    """The value in a JSON file of the dataset."""
    return parsed_json(read_content(root / name, "a table of the dataset", name), name)


def require_equal(found: object, expected: object, where: str, *, relative: float = 0.0) -> None:
    """Check that two JSON values are the same, all keys included.

    Numbers may differ by ``relative`` of the largest in their list, of lists and of 1.
    """
    for change in changed_values(found, expected):
        if not (relative and _is_near(change.found, change.asked, relative)):
            name = change.key or "the entry"
            raise InputError(f"{where}: {name} is {short(change.found)}, expected {short(change.asked)}")


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


def _is_near(found: object, expected: object, relative: float) -> bool:
    """Whether two numbers or lists of numbers are the same within rounding."""
    try:
        one, other = np.asarray(found), np.asarray(expected)
    except ValueError:  # lists of several lengths
        return False
    if one.shape != other.shape or one.dtype.kind not in "if" or other.dtype.kind not in "if":
        return False
    return bool((np.abs(one - other) <= relative * max(np.abs(other).max(initial=0), 1.0)).all())
