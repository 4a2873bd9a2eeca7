"""The origin of a pose: the optional table ``[alignment]`` of a case file, checked.

It records how the pose was found and its uncertainty; nothing is computed from it.
"""

import math
from collections.abc import Mapping
from datetime import date, datetime
from typing import Any

import numpy as np

from ..errors import InputError
from ..files.keys import check_keys

KEYS = (
    "method",
    "tool",
    "date",
    "pairs",
    "rms_px",
    "click_sigma_px",
    "standard_deviation_deg",
    "standard_deviation_mm",
    "weakest",
)
"""In the order in which they are written.

``method``
    How the pose was found, in words: "landmarks", "refined", "manual".
``tool``, ``date``
    Program and version; day or time in ISO 8601.
``pairs``, ``rms_px``
    Number of correspondences that the pose was computed from, and their root mean square reprojection error.
``click_sigma_px``
    The standard deviation of the click noise that the uncertainty assumes.
``standard_deviation_deg``, ``standard_deviation_mm``
    Standard deviations of rotation and translation along the camera's x, y and z axis.
``weakest``
    The least certain direction, in words.
"""

_TEXTS, _LENGTHS_PX = ("method", "tool", "weakest"), ("rms_px", "click_sigma_px")


def checked_alignment_record(table: object, where: str) -> dict[str, object]:
    """Check a table ``[alignment]``; every key may be missing.

    Returns
    -------
    The table in plain Python types, in the order of :data:`KEYS`; ``date`` as text.

    Raises
    ------
    InputError
        Not a table, an unknown key, or a value of the wrong kind.
    """
    if not isinstance(table, Mapping):
        raise InputError(f"{where}: expected a table, found {table!r}")
    check_keys(table, (), KEYS, f"{where} ")
    return {key: _checked(key, table[key], f"{where} {key}") for key in KEYS if key in table}


def _checked(key: str, value: Any, where: str) -> object:
    if key in _TEXTS:
        if not isinstance(value, str):
            raise InputError(f"{where}: expected text, found {value!r}")
        return value
    if key == "date":
        return _checked_date(value, where)
    if key == "pairs":
        if not _is_number(value) or value != int(value) or value < 0:
            raise InputError(f"{where}: expected the number of landmarks, found {value!r}")
        return int(value)
    if key in _LENGTHS_PX:
        if not _is_number(value) or value < 0:
            raise InputError(f"{where}: expected a number of pixels, found {value!r}")
        return float(value)
    values: list[Any] = list(value) if isinstance(value, list | tuple | np.ndarray) else []
    if len(values) != 3 or not all(_is_number(each) and each >= 0 for each in values):
        raise InputError(f"{where}: expected three numbers, for the camera's x, y and z axis, found {value!r}")
    return [float(each) for each in values]


def _is_number(value: Any) -> bool:
    if isinstance(value, bool) or not isinstance(value, int | float | np.integer | np.floating):
        return False
    try:
        return math.isfinite(value)
    except OverflowError:  # an integer too large for a float
        return False


def _checked_date(value: Any, where: str) -> str:
    if isinstance(value, date):  # TOML has dates; a datetime is a date too
        return value.isoformat()
    try:
        datetime.fromisoformat(value)
    except (TypeError, ValueError):
        raise InputError(f'{where}: expected a date such as "2026-03-31", found {value!r}') from None
    return str(value)
