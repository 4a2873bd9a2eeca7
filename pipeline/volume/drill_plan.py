"""The plan of a virtual drill: strokes of spherical burrs, and how near they may come to what must stay.

A plan is a TOML file in the frame of the mesh (LPS), mm::

    [margins]
    facial_nerve = 1.0

    [[strokes]]
    radius_mm = 3.0
    points = [[48.5, 35.0, 35.5], [48.5, 46.0, 36.0]]
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import InputError
from ..files.content import LARGEST_TEXT, read_content, write_bytes_atomically
from ..files.keys import check_keys
from ..files.kinds import Kind
from ..files.outputs import Output, check_outputs, writing
from ..files.tables import parsed_toml
from .volume import VoxelGrid

MOST_POINTS = 10_000
"""Of all strokes together; the text of so many is always shorter than the longest that is read."""
LARGEST_RADIUS_MM = 50.0
LARGEST_MARGIN_MM = 100.0
LARGEST_COORDINATE_MM = 1e5
"""Larger numbers mean another unit."""


@dataclass(frozen=True)
class Stroke:
    """A burr swept along a polyline.

    Attributes
    ----------
    radius_mm
        Radius of the burr, positive.
    points
        ``(N, 3)`` centres of the burr in the frame of the mesh (LPS), mm; one point is a burr at rest.
    """

    radius_mm: float
    points: np.ndarray


@dataclass(frozen=True)
class DrillPlan:
    """Strokes and margins.

    Attributes
    ----------
    strokes
        In any order: their union is removed.
    margins_mm
        Least thickness that stays around each structure, by its name.
    """

    strokes: tuple[Stroke, ...]
    margins_mm: Mapping[str, float] = field(default_factory=dict)


def read_drill_plan(path: Path) -> DrillPlan:
    """Read a plan.

    Raises
    ------
    InputError
        No file, not TOML, an unknown key, or a number that cannot be used; the message names the stroke.
    """
    return _parsed(read_content(path, "a drill plan", most=LARGEST_TEXT), path.name)


def write_drill_plan(path: Path, plan: DrillPlan, *, inputs: Mapping[str, Path] | None = None) -> None:
    """Write a plan, whole or not at all; :func:`read_drill_plan` gives it back to the last bit.

    Parameters
    ----------
    inputs
        Files that must not be replaced, by what they are.

    Raises
    ------
    InputError
        An existing file that is an input or no drill plan; or a plan that could not be read back.
    RunError
        The file cannot be written.
    """
    check_outputs([Output(path, DRILL_PLAN)], inputs or {})
    text = drill_plan_text(plan)
    _parsed(text, path.name)
    with writing(path):
        write_bytes_atomically(path, text.encode())


def drill_plan_text(plan: DrillPlan) -> str:
    """The plan as TOML."""
    lines = []
    if plan.margins_mm:
        lines.append("[margins]")
        lines += [f"{_quoted(name)} = {float(margin)!r}" for name, margin in plan.margins_mm.items()]
    for stroke in plan.strokes:
        lines += ["", "[[strokes]]", f"radius_mm = {float(stroke.radius_mm)!r}", "points = ["]
        lines += [f"    [{', '.join(repr(float(value)) for value in point)}]," for point in stroke.points]
        lines.append("]")
    return "\n".join(lines).lstrip("\n") + "\n"


def check_strokes_within(strokes: Sequence[Stroke], grid: VoxelGrid, where: str) -> list[str]:
    """Check that every stroke reaches the volume.

    Returns
    -------
    A message if some leave it: the field of a drill is open from outside where bone reaches the border.

    Raises
    ------
    InputError
        A stroke lies wholly outside; ``where`` begins the message.
    """
    beyond = []
    for number, stroke in enumerate(strokes, 1):
        points = index_points(grid, stroke.points)
        ends = np.concatenate([points[:1], points]), np.concatenate([points[:1], points[1:], points[-1:]])
        lower = np.minimum(*ends) - stroke.radius_mm / grid.spacing_mm
        upper = np.maximum(*ends) + stroke.radius_mm / grid.spacing_mm
        last = np.array(grid.size) - 0.5
        if not ((upper > -0.5) & (lower < last)).all(axis=1).any():
            box = np.stack([stroke.points.min(axis=0), stroke.points.max(axis=0)])
            box += [[-stroke.radius_mm], [stroke.radius_mm]]
            raise InputError(
                f"{where}: stroke {number}: expected a stroke that reaches the volume, {_box(grid.bounds_mm)}, found "
                f"one in {_box(box)}, all of it outside; the points are LPS mm: correct them, or take the volume "
                "that the plan was made for"
            )
        if (lower < -0.5).any() or (upper > last).any():
            beyond.append(str(number))
    if not beyond:
        return []
    named = ", ".join(beyond[:8]) + (f" and {len(beyond) - 8} more" if len(beyond) > 8 else "")
    return [f"{where}: {'strokes' if len(beyond) > 1 else 'stroke'} {named} of {len(strokes)}: partly outside"]


def index_points(grid: VoxelGrid, points: np.ndarray) -> np.ndarray:
    """``(N, 3)`` points of the frame of the mesh in index space; each one's bits do not depend on the others."""
    # not by a matrix product, whose last bits depend on the number of points
    return np.stack(
        [sum((points[:, i] * m[i] for i in range(3)), np.zeros(len(points))) + m[3] for m in grid.index_from_mesh[:3]],
        axis=1,
    )


def _parsed(content: str | bytes, where: str) -> DrillPlan:
    table = parsed_toml(content, where)
    check_keys(table, ("strokes",), ("margins",), f"{where}: ")
    entries = table["strokes"]
    if not (isinstance(entries, list) and entries and all(isinstance(entry, dict) for entry in entries)):
        raise InputError(
            f"{where}: expected strokes as tables [[strokes]], found {_short(entries)}; write at least one"
        )
    strokes, count = [], 0
    for number, entry in enumerate(entries, 1):
        place = f"{where}: stroke {number}: "
        check_keys(entry, ("radius_mm", "points"), (), place)
        radius = _number(entry["radius_mm"], f"{place}radius_mm", 0, LARGEST_RADIUS_MM)
        if radius == 0:
            raise InputError(f"{place}radius_mm: expected a positive length in mm, found 0; correct it")
        count += len(entry["points"]) if isinstance(entry["points"], list) else 0
        if count > MOST_POINTS:
            raise InputError(f"{where}: expected up to {MOST_POINTS:,} points, found more; merge or thin out strokes")
        strokes.append(Stroke(radius, _points(entry["points"], f"{place}points")))
    margins = table.get("margins", {})
    if not isinstance(margins, dict):
        raise InputError(f"{where}: margins: expected a table [margins] of lengths in mm, found {_short(margins)}")
    return DrillPlan(
        tuple(strokes),
        {name: _number(mm, f"{where}: margins: {name[:60]}", 0, LARGEST_MARGIN_MM) for name, mm in margins.items()},
    )


def _points(value: object, where: str) -> np.ndarray:
    if not (isinstance(value, list) and value):
        raise InputError(f"{where}: expected a list of points [x, y, z], found {_short(value)}")
    rows = []
    for number, row in enumerate(value, 1):
        place = f"{where}: point {number}"
        if not (isinstance(row, list) and len(row) == 3):
            raise InputError(f"{place}: expected three numbers [x, y, z] in LPS mm, found {_short(row)}")
        rows.append([_number(each, place, -LARGEST_COORDINATE_MM, LARGEST_COORDINATE_MM) for each in row])
    return np.array(rows)


def _number(value: Any, where: str, least: float, most: float) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise InputError(f"{where}: expected a length in mm, found {_short(value)}; write a number")
    if not least <= value <= most:
        raise InputError(f"{where}: expected {least:g} to {most:g} mm, found {float(value):g}; correct it")
    return float(value)


def _short(value: object) -> str:
    text = repr(value)
    return text if len(text) <= 60 else f"{text[:57]}..."


def _box(corners: np.ndarray) -> str:
    return " to ".join(f"({', '.join(f'{value:.1f}' for value in corner)})" for corner in corners) + " mm"


def _quoted(name: str) -> str:
    escaped = name.replace("\\", "\\\\").replace('"', '\\"')
    return '"' + "".join(f"\\u{ord(c):04x}" if ord(c) < 32 or ord(c) == 127 else c for c in escaped) + '"'


def _holds_plan(data: bytes) -> bool:
    try:
        return bool(_parsed(data, "").strokes)
    except InputError:
        return False


DRILL_PLAN = Kind("a drill plan", _holds_plan)
