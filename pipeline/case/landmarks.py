"""Landmarks as tables ``{name, surface, pixel, enabled}``, the form of both case files and landmark files."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..camera.pinhole import PixelOrigin
from ..errors import InputError
from ..files.keys import check_keys
from ..files.numbers import is_number, millimetres

MOST_LANDMARKS = 10_000


@dataclass(frozen=True)
class Landmark:
    """A 2D-3D correspondence: a point of the surface and its pixel in the frame; either may still be missing.

    Attributes
    ----------
    name
        Unique within a list of landmarks.
    point
        mm; in a :class:`~oneframe.case.case_file.Case` in the frame ``mesh``.
    pixel
        px in the *undistorted* frame, with (0, 0) at the centre of the top-left pixel.
    enabled
        False: the alignment ignores the landmark.
    """

    name: str
    point: tuple[float, float, float] | None
    pixel: tuple[float, float] | None
    enabled: bool = True


_NOT_IN_NAMES = re.compile("[\x00-\x1f\x7f\ud800-\udfff]")
"""Line breaks and other control characters, and surrogates, which are not valid Unicode text."""


def landmarks_from_tables(
    entries: object, where: str, *, mm_per_unit: float = 1.0, pixel_origin: PixelOrigin = "center"
) -> tuple[Landmark, ...]:
    """Check the user's landmarks.

    Parameters
    ----------
    entries
        List of tables with ``name`` and, if known, ``surface`` = [x, y, z] in the mesh file's frame and units and
        ``pixel`` = [u, v] px in the undistorted frame; ``enabled`` is true by default.
    where
        Names the list in messages, e.g. ``"case.toml: [[landmarks]]"``.
    mm_per_unit
        Factor from the units of ``surface`` to millimetres.
    pixel_origin
        Whether (0, 0) of ``pixel`` is the centre or the corner of the top-left pixel.

    Returns
    -------
    Points in mm, pixels with (0, 0) at the centre of the top-left pixel.
    """
    if not isinstance(entries, list) or not all(isinstance(entry, dict) for entry in entries):
        raise InputError(f"{where}: expected a list of tables with name, surface and pixel, found {entries!r}")
    if len(entries) > MOST_LANDMARKS:
        raise InputError(f"{where}: expected up to {MOST_LANDMARKS} landmarks, found {len(entries)}; keep the best")
    landmarks: dict[str, Landmark] = {}
    for number, entry in enumerate(entries, start=1):
        landmark = landmark_from_table(
            entry, f"{where} number {number}: ", mm_per_unit=mm_per_unit, pixel_origin=pixel_origin
        )
        if landmark.name in landmarks:
            raise InputError(
                f"{where}: expected a different name for each landmark, found {landmark.name!r} twice; rename one"
            )
        landmarks[landmark.name] = landmark
    return tuple(landmarks.values())


def landmark_from_table(
    entry: Mapping[str, Any], place: str, *, mm_per_unit: float = 1.0, pixel_origin: PixelOrigin = "center"
) -> Landmark:
    """Check one landmark; ``place`` begins the messages. Strips white space around the name."""
    check_keys(entry, ("name",), ("surface", "pixel", "enabled"), place)
    name, point, pixel = checked_name(entry["name"], place), None, None
    if "surface" in entry:
        x, y, z = _numbers(entry["surface"], 3, f"{place}expected surface = [x, y, z]")
        point = (millimetres(x, mm_per_unit), millimetres(y, mm_per_unit), millimetres(z, mm_per_unit))
        if not np.isfinite(point).all():
            raise InputError(f"{place}expected smaller numbers in surface = [x, y, z], found {entry['surface']!r}")
    if "pixel" in entry:
        shift = 0.5 if pixel_origin == "corner" else 0.0
        u, v = _numbers(entry["pixel"], 2, f"{place}expected pixel = [u, v]")
        pixel = (float(u) - shift, float(v) - shift)
    enabled = entry.get("enabled", True)
    if not isinstance(enabled, bool):
        raise InputError(f"{place}expected enabled = true or false, found {enabled!r}")
    return Landmark(name.strip(), point, pixel, enabled)


def checked_name(name: object, place: str) -> str:
    """Check the name of a landmark or a structure: not blank, on one line; ``place`` begins the message."""
    if not isinstance(name, str) or not name.strip() or _NOT_IN_NAMES.search(name):
        raise InputError(f"{place}expected a name, found {name!r}")
    return name


def _numbers(values: Any, count: int, expected: str) -> list[float]:
    if not isinstance(values, list) or len(values) != count or not all(map(is_number, values)):
        raise InputError(f"{expected}, {count} finite numbers, found {values!r}")
    return values
