"""Comparing what a file holds with what it should: exact for values, within rounding for numbers computed again."""

import math
from collections.abc import Iterable

import numpy as np
from numpy.typing import ArrayLike

from .files import DamagedFile, shortened

RELATIVE = 1e-9
"""Allowed relative error of a number that is computed again."""


def require_equal(found: object, expected: object, where: str, see: str = "") -> None:
    """Check that two JSON values are the same, all keys included; :class:`DamagedFile` with the first difference."""
    if found != expected:
        raise DamagedFile(f"{where}: {_difference(found, expected)}{see and f', see {see}'}")


def require_entries(found: Iterable[str], expected: set[str], where: str) -> None:
    """Check that a table has an entry for each of the images; :class:`DamagedFile` if not."""
    missing, surplus = expected - set(found), set(found) - expected
    if missing or surplus:
        problems = [
            f"{len(some)} {what} ({', '.join(sorted(some)[:3])})"
            for some, what in ((missing, "missing"), (surplus, "unexpected"))
            if some
        ]
        raise DamagedFile(f"{where}: expected an entry for each of {len(expected)} images, {' and '.join(problems)}")


def is_close(found: ArrayLike, expected: ArrayLike, size: float) -> bool:
    """Whether numbers of about this size are the same within rounding."""
    return bool((np.abs(np.subtract(found, expected)) <= RELATIVE * max(size, 1.0)).all())


def require_pose(found: np.ndarray, expected: np.ndarray, where: str, see: str) -> None:
    """Check that two 4x4 poses are the same within rounding; :class:`DamagedFile` if not."""
    rotation_ok = is_close(found[:3, :3], expected[:3, :3], 1.0)
    if not rotation_ok or not is_close(found[:3, 3], expected[:3, 3], float(np.abs(expected[:3, 3]).max())):
        part = (slice(0, 3), 3) if rotation_ok else (slice(0, 3), slice(0, 3))
        name = "translation" if rotation_ok else "rotation"
        difference = np.abs(found[part] - expected[part]).max()
        raise DamagedFile(f"{where}: the {name} differs from that of {see} by {difference:.2g}")


def finite_number(text: str, where: str) -> float:
    """The number in a cell of a CSV table; :class:`DamagedFile` if there is none."""
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise DamagedFile(f"{where}: expected a number, found {shortened(text)}")
    return value


def _difference(found: object, expected: object, name: str = "the entry") -> str:
    """The first difference of two JSON values, as a clause."""
    if isinstance(found, dict) and isinstance(expected, dict):
        for key in (*expected, *found):
            if key not in expected:
                return f"unexpected key {shortened(key)}"
            if key not in found or found[key] != expected[key]:
                return _difference(found.get(key), expected[key], key)
    if isinstance(found, list) and isinstance(expected, list) and len(found) == len(expected):
        for number, pair in enumerate(zip(found, expected, strict=True)):
            if pair[0] != pair[1]:
                return _difference(*pair, f"{name}[{number}]" if len(found) > 1 else name)
    return f"{name} is {shortened(found)}, expected {shortened(expected)}"
