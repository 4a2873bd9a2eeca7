"""The plan of a virtual drill: strokes of spherical burrs, and how near they may come to what must stay; its file.

A TOML file in the frame of the mesh (LPS), mm::

    [margins_mm]
    facial_nerve = 1.0

    [[strokes]]
    radius_mm = 3.0
    points_mm = [[48.5, 35.0, 35.5], [48.5, 46.0, 36.0]]
"""

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from ...errors import InputError
from ...files.content import LARGEST_TEXT, read_content
from ...files.keys import check_keys
from ...files.numbers import is_number
from ...files.tables import parsed_toml
from ...transforms import transform_points
from ..volume import VoxelGrid

LARGEST_RADIUS_MM = 50.0
LARGEST_MARGIN_MM = 20.0
MOST_MM = 1e5
"""Largest coordinate: 100 m."""
MOST_POINTS = 10_000
"""Points of all strokes together; so many are always shorter than the longest text that is read."""


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

    @property
    def bounds_mm(self) -> np.ndarray:
        """``(2, 3)`` smallest and largest coordinates of what it removes, mm."""
        return np.stack([self.points.min(axis=0) - self.radius_mm, self.points.max(axis=0) + self.radius_mm])


@dataclass(frozen=True)
class DrillPlan:
    """Strokes and margins.

    The union of the strokes is removed; ``margins_mm`` is the least thickness of bone that stays around each structure.
    """

    strokes: tuple[Stroke, ...] = ()
    margins_mm: Mapping[str, float] = field(default_factory=dict)


def read_drill_plan(path: Path) -> DrillPlan:
    """Read and check a plan."""
    return _parsed(read_content(path, "a drill plan", most=LARGEST_TEXT), path.name)


def check_strokes(plan: DrillPlan, grid: VoxelGrid, where: str) -> list[str]:
    """Check that every stroke meets the volume; return messages about those that lie partly outside it."""
    partly = []
    last = np.array(grid.size) - 0.5
    for number, stroke in enumerate(plan.strokes, 1):
        points = transform_points(grid.index_from_mesh, stroke.points)
        reach = stroke.radius_mm / grid.spacing_mm
        starts = np.concatenate([points[:1], points[:-1]])
        low, high = np.minimum(starts, points) - reach, np.maximum(starts, points) + reach
        if not ((high > -0.5) & (low < last)).all(axis=1).any():
            raise InputError(
                f"{where}: stroke {number}: expected points in the volume, {_box(*grid.bounds_mm)}, found a stroke in "
                f"{_box(*stroke.bounds_mm)}, all of it outside; coordinates are LPS, mm: correct them, or take the "
                "volume that the plan was made for"
            )
        if ((points < -0.5) | (points > last)).any():
            partly.append(number)
    if not partly:
        return []
    return [
        f"{where}: {len(partly)} of {len(plan.strokes)} strokes begin, bend or end outside the volume "
        f"(the first: stroke {partly[0]})"
    ]


def unprotected(margins_mm: Mapping[str, float]) -> tuple[str, ...]:
    """A message if a drill that keeps these margins spares nothing."""
    return () if margins_mm else ("nothing is protected from the drill: give labels, and margins of their structures",)


def check_margins(margins_mm: Collection[str], structures: Collection[str]) -> None:
    """Check that there is a structure of the name for each margin."""
    missing = sorted(set(margins_mm) - set(structures))
    if missing:
        raise InputError(
            f"margins: expected structures of the label map ({', '.join(sorted(structures)) or 'there are none'}), "
            f"found {', '.join(missing)}; give labels that have them, with their names in labels.json, dataset.json or "
            "ITK-SNAP's label descriptions (.txt) beside them, or remove their margins"
        )


def _parsed(content: str | bytes, name: str) -> DrillPlan:
    table = parsed_toml(content, name)
    check_keys(table, ("strokes",), ("margins_mm",), f"{name}: ")
    entries, margins = table["strokes"], table.get("margins_mm", {})
    if not isinstance(entries, list) or not entries:
        raise InputError(f"{name}: expected tables [[strokes]], found {_shown(entries)}; write at least one")
    if not isinstance(margins, dict):
        raise InputError(f"{name}: expected a table [margins_mm], found {_shown(margins)}")
    strokes = tuple(_stroke(entry, f"{name}: stroke {number}") for number, entry in enumerate(entries, 1))
    count = sum(len(stroke.points) for stroke in strokes)
    if count > MOST_POINTS:
        raise InputError(f"{name}: expected up to {MOST_POINTS:,} points, found {count:,}; thin out the strokes")
    return DrillPlan(
        strokes,
        {
            structure: _length(value, f"{name}: [margins_mm] {_shown(structure)}", LARGEST_MARGIN_MM, or_zero=True)
            for structure, value in margins.items()
        },
    )


def _stroke(entry: Any, where: str) -> Stroke:
    if not isinstance(entry, dict):
        raise InputError(f"{where}: expected a table, found {_shown(entry)}")
    check_keys(entry, ("radius_mm", "points_mm"), (), f"{where}: ")
    points = entry["points_mm"]
    rows = points if isinstance(points, list) else []
    for row in rows:
        numbers: list[Any] = row if isinstance(row, list) and len(row) == 3 else [None]
        if not all(is_number(value) and abs(value) <= MOST_MM for value in numbers):
            raise InputError(f"{where}: points_mm: expected points [x, y, z] in mm, found {_shown(row)}")
    if not rows:
        raise InputError(f"{where}: points_mm: expected a list of points [x, y, z] in mm, found {_shown(points)}")
    return Stroke(
        _length(entry["radius_mm"], f"{where}: radius_mm", LARGEST_RADIUS_MM), np.array(rows, dtype=np.float64)
    )


def _length(value: Any, where: str, most: float, *, or_zero: bool = False) -> float:
    if not is_number(value) or not ((value >= 0 if or_zero else value > 0) and value <= most):
        least = "from 0" if or_zero else "above 0"
        raise InputError(f"{where}: expected a length {least} to {most:g} mm, found {_shown(value)}")
    return float(value)


def _box(lower: np.ndarray, upper: np.ndarray) -> str:
    return f"{np.round(lower, 1).tolist()} to {np.round(upper, 1).tolist()}"


def _shown(value: object) -> str:
    text = repr(float(value)) if isinstance(value, float) else repr(value)
    return text if len(text) < 60 else text[:57] + "..."
