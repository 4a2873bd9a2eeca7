"""Landmark files: CSV for spreadsheets, JSON for programs.

The CSV has a header ``name,x,y,z,u,v,enabled`` (any order; commas, semicolons or tabs; others are ignored), the JSON is
a list of ``{"name", "surface": [x, y, z], "pixel": [u, v], "enabled"}``, as in a case file. Points are in the frame
and units of the mesh file, pixels in the undistorted frame with (0, 0) at the centre of the top-left pixel. Without a
point or without a pixel, a landmark is incomplete.
"""

import csv
import difflib
import io
from pathlib import Path

from ..errors import InputError
from ..files.content import LARGEST_TEXT, decoded, read_content
from ..files.numbers import WrittenFloat
from ..files.tables import parsed_json
from .landmarks import MOST_LANDMARKS, Landmark, landmark_from_table, landmarks_from_tables

COLUMNS = ("name", "x", "y", "z", "u", "v", "enabled")
MOST_COLUMNS = 1000
_BOOLEANS = {"": True, "true": True, "1": True, "yes": True, "false": False, "0": False, "no": False}


def read_landmarks(path: Path, *, mm_per_unit: float = 1.0) -> tuple[Landmark, ...]:
    """Read landmarks, points in mm: JSON if the file begins with a bracket, else CSV.

    ``mm_per_unit`` is the factor from the unit of the points, that of the mesh file, to millimetres.
    """
    path = Path(path)
    text = decoded(read_content(path, "a file with landmarks", most=LARGEST_TEXT))
    if text is None:
        raise InputError(f"{path.name}: expected landmarks as CSV or JSON, found another kind of file")
    return _parsed(text, path.name, mm_per_unit)


def _parsed(text: str, name: str, mm_per_unit: float) -> tuple[Landmark, ...]:
    if text.lstrip().startswith(("[", "{")):
        return _from_json(text, name, mm_per_unit)
    return _from_csv(text, name, mm_per_unit)


def _from_json(text: str, name: str, mm_per_unit: float) -> tuple[Landmark, ...]:
    return landmarks_from_tables(
        parsed_json(text, name, parse_float=WrittenFloat), f"{name}: landmark", mm_per_unit=mm_per_unit
    )


def _from_csv(text: str, name: str, mm_per_unit: float) -> tuple[Landmark, ...]:
    header = next((line for line in text.splitlines() if line.strip()), "")
    # a line may end with a carriage return alone
    separator = max(",;\t", key=header.count)
    rows = csv.reader(io.StringIO(text, newline=None), delimiter=separator, strict=True)
    names: list[str] = []
    found: dict[str, tuple[int, Landmark]] = {}
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
                raise InputError(
                    f"{place}expected cells between {separator!r} as in the header, found {cells[0][:60]!r}"
                )
            landmark = landmark_from_table(_table(names, cells, place), place, mm_per_unit=mm_per_unit)
            if len(found) == MOST_LANDMARKS:
                raise InputError(f"{place}expected up to {MOST_LANDMARKS} landmarks, found more; keep the best")
            line, _ = found.setdefault(landmark.name, (rows.line_num, landmark))
            if line != rows.line_num:
                raise InputError(f"{place}expected another name, {landmark.name!r} is also in line {line}; rename one")
    except csv.Error as error:
        raise InputError(f"{name}: line {rows.line_num}: expected CSV, found a mistake: {error}") from None
    if not names:
        raise InputError(f"{name}: expected a header {','.join(COLUMNS)}, found none")
    return tuple(landmark for _, landmark in found.values())


def _checked_header(cells: list[str], place: str) -> list[str]:
    if len(cells) > MOST_COLUMNS:
        raise InputError(f"{place}expected a header {','.join(COLUMNS)}, found {len(cells)} columns; leave only these")
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
        raise InputError(f"{place}expected enabled = true or false, found {row['enabled']!r}")
    return entry | {"enabled": _BOOLEANS[row["enabled"].lower()]}


def _number(text: str, place: str) -> float:
    try:
        if "_" in text:  # float() accepts it, CSV does not
            raise ValueError
        return WrittenFloat(text)
    except ValueError:
        found = "an empty cell" if not text else repr(text)
        hint = "; write a decimal point" if "," in text else ""
        raise InputError(f"{place}expected a number, found {found}{hint}") from None
