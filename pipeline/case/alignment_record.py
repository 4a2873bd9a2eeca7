"""The origin of a pose: the optional table ``[alignment]`` of a case file, checked.

It records how the pose was found and its uncertainty. Only ``image`` is computed with: what a refinement has found.
"""

import re
from collections.abc import Mapping
from datetime import date
from typing import Any

import numpy as np

from ..errors import InputError
from ..files.keys import check_keys
from ..files.numbers import format_two_digits, is_number

KEYS = (
    "method",
    "tool",
    "date",
    "checked",
    "doubt",
    "refused",
    "probability",
    "start_frame",
    "start_method",
    "start_pairs",
    "start_rms_px",
    "pairs",
    "rms_px",
    "click_sigma_px",
    "error_px",
    "start_error_px",
    "explained",
    "start_explained",
    "moved_px",
    "moved_deg",
    "split_half_px",
    "second_peak_ratio",
    "standard_deviation_deg",
    "standard_deviation_mm",
    "weakest",
    "covariance_mm_rad",
    "pivot_mesh_mm",
    "radius_mm",
)
"""In the order in which they are written.

``method``
    How the pose was found, in words: "landmarks", "pins", "refined", "manual"; :data:`REGISTERED`,
    :data:`FURTHER_FRAMES`, :data:`INITIAL_GUESS`, :data:`OTHER_FRAME`.
``tool``, ``date``
    Program and version; day or time in ISO 8601.
``checked``
    Day on which a person has looked at the pose and found it right.
``doubt``
    Why the pose may be wrong altogether: several fit the landmarks, none does, it was found in another frame, or little
    of the frame agrees with it.
``refused``
    Why the refinement was refused, whose result the user took all the same.
``probability``
    That a registered pose is right, 0..1.
``start_frame``
    File of the aligned frame to which this one was registered; ``start_method`` is that frame's.
``start_method``, ``start_pairs``, ``start_rms_px``
    Of the initial pose of a refinement: its ``method``, ``pairs`` and ``rms_px``.
``pairs``, ``rms_px``
    Number of correspondences that the pose was computed from, and their root mean square reprojection error.
``click_sigma_px``
    The standard deviation of the click noise that the uncertainty assumes.
``error_px``, ``start_error_px``
    Estimated errors of the refined and of the initial pose: root mean square displacement of the visible surface.
``explained``, ``start_explained``
    Fractions, 0..1, of the image's variation that the surface explains at the refined and at the initial pose.
``moved_px``, ``moved_deg``
    From the initial to the refined pose: mean shift of the visible surface, and angle of rotation.
``split_half_px``, ``second_peak_ratio``
    Verification of a refined pose: distance between the poses from two halves of the image; score of the next best
    place over that of the pose.
``standard_deviation_deg``, ``standard_deviation_mm``
    Standard deviations of rotation and translation along the camera's x, y and z axis.
``weakest``
    The least certain direction, in words.
``covariance_mm_rad``, ``pivot_mesh_mm``, ``radius_mm``
    What these come from, of a pose that was registered or corrected by further frames: the covariance of a twist in
    camera axes (mm, radians) about a pivot in the frame of the mesh, and the radius that makes rotations comparable
    with shifts.
"""

INITIAL_GUESS = "initial guess"
"""Method of a pose that was computed without the frame: nobody has aligned it."""

FURTHER_FRAMES = "further frames"
"""Method of a pose that was corrected by further frames of the surface."""

REGISTERED = "registered"
"""Method of a pose that was found by what an aligned frame of the surface shows."""

OTHER_FRAME = "another frame"
"""Method of a pose that was found in another frame: a start for this one."""

FOUND = ("refined", FURTHER_FRAMES, REGISTERED)
"""Methods of poses that the image or other frames have found: neither landmarks nor hands replace them unasked."""

ENTRY_SHAPES: dict[str, tuple[int, ...]] = {"covariance_mm_rad": (6, 6), "pivot_mesh_mm": (3,), "radius_mm": ()}
"""Shapes of what determines the uncertainty of a pose that does not come from clicks, in the frame of the mesh."""

_MILLIMETRES = re.compile(r"[0-9]+(?:\.[0-9]+)?(?:e[+-]?[0-9]+)?(?= mm\b)")

_TEXTS = ("method", "tool", "date", "checked", "doubt", "refused", "start_frame", "start_method", "weakest")


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


def is_a_start(record: Mapping[str, object]) -> bool:
    """Whether nobody has aligned a pose with this record in its frame."""
    return record.get("method") in (INITIAL_GUESS, OTHER_FRAME)


def is_found(record: Mapping[str, object]) -> bool:
    """Whether a pose with this record was found in the image or in other frames, or checked by a person."""
    return record.get("method") in FOUND or "checked" in record


def scaled_record(record: Mapping[str, object], factor: float) -> dict[str, object]:
    """The record of the same pose with the surface scaled about the camera's centre.

    Pixels and angles stay, millimetres are multiplied, those in the words of ``weakest`` as well.
    """
    scaled = dict(record)
    if isinstance(deviations := record.get("standard_deviation_mm"), list):
        scaled["standard_deviation_mm"] = [value * factor for value in deviations]
    if "covariance_mm_rad" in record:
        scale = np.array([factor] * 3 + [1.0] * 3)
        scaled["covariance_mm_rad"] = (np.array(record["covariance_mm_rad"]) * np.outer(scale, scale)).tolist()
        lengths = [key for key in ("pivot_mesh_mm", "radius_mm") if key in record]
        scaled |= {key: (np.array(record[key]) * factor).tolist() for key in lengths}
    if isinstance(words := record.get("weakest"), str):
        scaled["weakest"] = _MILLIMETRES.sub(lambda found: format_two_digits(float(found[0]) * factor), words)
    return scaled


def _checked(key: str, value: Any, where: str) -> object:
    if key in _TEXTS:
        if isinstance(value, date):  # TOML has dates; a datetime is a date too
            return value.isoformat()
        if not isinstance(value, str):
            raise InputError(f"{where}: expected text, found {value!r}")
        return value
    if key in ENTRY_SHAPES:
        numbers = _numbers(value, ENTRY_SHAPES[key], where)
        return _checked_covariance(numbers, where).tolist() if key == "covariance_mm_rad" else numbers.tolist()
    if not key.startswith("standard_deviation"):
        if not is_number(value) or value < 0:
            raise InputError(f"{where}: expected a number from 0, found {value!r}")
        return int(value) if key.endswith("pairs") else float(value)
    values = value if isinstance(value, list) else []
    if len(values) != 3 or not all(is_number(each) and each >= 0 for each in values):
        raise InputError(f"{where}: expected three numbers, for the camera's x, y and z axis, found {value!r}")
    return [float(each) for each in values]


def _numbers(given: Any, shape: tuple[int, ...], where: str) -> np.ndarray:
    try:
        values = np.array(given, np.float64)
    except (TypeError, ValueError, OverflowError):
        values = np.full(0, np.nan)
    if values.shape != shape or not np.isfinite(values).all():
        size = " x ".join(map(str, shape)) or "1"
        raise InputError(f"{where}: expected {size} finite numbers, found {given!r}")
    return values


def _checked_covariance(values: np.ndarray, where: str) -> np.ndarray:
    if not np.allclose(values, values.T) or np.linalg.eigvalsh(values)[0] <= 0:
        raise InputError(f"{where}: expected a covariance, symmetric and positive definite; refine again")
    return values
