"""Landmarks as tables ``{name, surface, pixel, enabled}``, the form of case files, and in files of their own.

A CSV for spreadsheets has a header ``name,x,y,z,u,v,enabled`` (any order; commas, semicolons or tabs; others are
ignored); the JSON for programs is a list of such tables. Points are in the frame and units of the mesh file, pixels in
the undistorted frame with (0, 0) at the centre of the top-left pixel. Without a point or without a pixel, a landmark is
incomplete.
"""

from __future__ import annotations

import csv
import difflib
import io
import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ..camera.pinhole import PixelOrigin
from ..errors import InputError
from ..files.content import LARGEST_TEXT, decoded, read_content
from ..files.keys import check_keys, described
from ..files.numbers import WrittenFloat, is_number, millimetres
from ..files.tables import parsed_json

MOST_LANDMARKS = 10_000

COLUMNS = ("name", "x", "y", "z", "u", "v", "enabled")
_BOOLEANS = {"": True, "true": True, "1": True, "yes": True, "false": False, "0": False, "no": False}


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
        raise InputError(f"{where}: expected a list of tables with name, surface and pixel, found {described(entries)}")
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
            raise InputError(
                f"{place}expected smaller numbers in surface = [x, y, z], found {described(entry['surface'])}"
            )
    if "pixel" in entry:
        shift = 0.5 if pixel_origin == "corner" else 0.0
        u, v = _numbers(entry["pixel"], 2, f"{place}expected pixel = [u, v]")
        pixel = (float(u) - shift, float(v) - shift)
    enabled = entry.get("enabled", True)
    if not isinstance(enabled, bool):
        raise InputError(f"{place}expected enabled = true or false, found {described(enabled)}")
    return Landmark(name.strip(), point, pixel, enabled)


def checked_name(name: object, place: str) -> str:
    """Check the name of a landmark or a structure: not blank, on one line; ``place`` begins the message."""
    if not isinstance(name, str) or not name.strip() or _NOT_IN_NAMES.search(name):
        raise InputError(f"{place}expected a name, found {described(name)}")
    return name


def _numbers(values: Any, count: int, expected: str) -> list[float]:
    if not isinstance(values, list) or len(values) != count or not all(map(is_number, values)):
        raise InputError(f"{expected}, {count} finite numbers, found {described(values)}")
    return values


def read_landmarks(path: Path, *, mm_per_unit: float = 1.0) -> tuple[Landmark, ...]:
    """Read landmarks, points in mm: JSON if the file begins with a bracket, else CSV.

    ``mm_per_unit`` is the factor from the unit of the points, that of the mesh file, to millimetres.
    """
    path = Path(path)
    text = decoded(read_content(path, "a file with landmarks", most=LARGEST_TEXT))
    if text is None:
        raise InputError(f"{path.name}: expected landmarks as CSV or JSON, found another kind of file")
    if "markups" in text[:500].lower():
        raise InputError(
            f"{path.name}: expected landmarks with a pixel each, found markups of 3D Slicer, which have none; write "
            f"each point, in the frame of the surface's file, and its pixel in a CSV with {','.join(COLUMNS)}"
        )
    if not text.lstrip().startswith(("[", "{")):
        return _from_csv(text, path.name, mm_per_unit)
    entries = parsed_json(text, path.name, parse_float=WrittenFloat)
    return landmarks_from_tables(entries, f"{path.name}: landmark", mm_per_unit=mm_per_unit)


def _from_csv(text: str, name: str, mm_per_unit: float) -> tuple[Landmark, ...]:
    header = next((line for line in text.splitlines() if line.strip()), "")
    # a line may end with a carriage return alone
    separator = max(",;\t", key=header.count)
    rows = csv.reader(io.StringIO(text, newline=None), delimiter=separator, strict=True)
    names: list[str] = []
    entries: list[dict[str, object]] = []
    try:
        for cells in rows:
            place = f"{name}: line {rows.line_num}: "
            if not any(cell.strip() for cell in cells):
                continue
            if not names:
                names = _checked_header(cells, place)
                continue
            if len(cells) > len(names):
                raise InputError(
                    f"{place}expected at most {len(names)} cells, as in the header, found {len(cells)}; "
                    "write decimal points, not commas"
                )
            if len(cells) == 1 and any(other in cells[0] for other in set(",;\t") - {separator}):
                raise InputError(f"{place}expected cells between {separator!r} as in the header, found other signs")
            entries.append(_table(names, cells, place))
    except csv.Error as error:
        raise InputError(f"{name}: line {rows.line_num}: expected CSV, found a mistake: {error}") from None
    if not names:
        raise InputError(f"{name}: expected a header {','.join(COLUMNS)}, found none")
    return landmarks_from_tables(entries, f"{name}: landmark", mm_per_unit=mm_per_unit)


def _checked_header(cells: list[str], place: str) -> list[str]:
    names = [cell.strip().lower() for cell in cells]
    for wanted in COLUMNS:
        if names.count(wanted) > 1:
            raise InputError(f"{place}expected one column {wanted!r}, found {names.count(wanted)}")
        if wanted not in names and wanted != "enabled":
            raise InputError(f"{place}expected a header {','.join(COLUMNS)}, found no column {wanted!r}")
    if "enabled" not in names and (near := difflib.get_close_matches("enabled", names, n=1)):
        raise InputError(f"{place}expected a column 'enabled', found {near[0]!r}; correct its name")
    return names


def _table(names: list[str], cells: list[str], place: str) -> dict[str, object]:
    """Convert a row of cells to the table of a landmark."""
    row = dict.fromkeys(COLUMNS, "") | {name: cell.strip() for name, cell in zip(names, cells, strict=False)}
    entry: dict[str, object] = {"name": row["name"]}
    for key, parts in (("surface", ("x", "y", "z")), ("pixel", ("u", "v"))):
        if any(row[part] for part in parts):
            entry[key] = [_number(row[part], f"{place}{part}: ") for part in parts]
    if row["enabled"].lower() not in _BOOLEANS:
        raise InputError(f"{place}expected enabled = true or false, found {described(row['enabled'])}")
    return entry | {"enabled": _BOOLEANS[row["enabled"].lower()]}


def _number(text: str, place: str) -> float:
    try:
        if "_" in text:  # float() accepts it, CSV does not
            raise ValueError
        return WrittenFloat(text)
    except ValueError:
        found = described(text) if text else "an empty cell"
        hint = "; write a decimal point" if "," in text else ""
        raise InputError(f"{place}expected a number, found {found}{hint}") from None
