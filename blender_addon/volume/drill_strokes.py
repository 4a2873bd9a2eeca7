"""What was drilled: strokes and margins in the scene's settings, which undo, files and the case rely on."""

import json
from collections.abc import Iterable, Mapping, Sequence
from functools import lru_cache

import bpy
import numpy as np

from ..pipeline.volume.drill.drill_plan import DrillPlan, Stroke

DIGITS = 3
"""Decimals of a millimetre that strokes keep: window, case and script have the same numbers."""

MARGINS_MM = {
    "facial_nerve": 1.0,
    "chorda_tympani": 0.8,
    "bony_labyrinth": 1.0,
    "sinus": 1.0,
    "sinus_dura": 1.0,
    "dura": 1.0,
    "ica": 1.0,
    "malleus": 1.0,
    "incus": 1.0,
    "stapes": 1.0,
    "ossicles": 1.0,
    "eac": 1.5,
}
"""Thickness of bone that the drill leaves around structures, unless a plan says otherwise."""


def strokes_of(scene: bpy.types.Scene) -> tuple[Stroke, ...]:
    """The strokes, in the order of drilling."""
    return _parsed(scene.oneframe_ct.strokes_text)


@lru_cache(maxsize=2)
def _parsed(text: str) -> tuple[Stroke, ...]:
    """The strokes of a text: panels and views ask for them whenever they are drawn."""
    return tuple(Stroke(radius, np.array(points, np.float64)) for radius, points in json.loads(text or "[]"))


def set_strokes(scene: bpy.types.Scene, strokes: Sequence[Stroke]) -> None:
    """Store the strokes in the scene."""
    rows = [[stroke.radius_mm, stroke.points.tolist()] for stroke in strokes]
    scene.oneframe_ct.strokes_text = json.dumps(rows, separators=(",", ":")) if rows else ""


def plan_of(scene: bpy.types.Scene) -> DrillPlan:
    """Strokes, and the margins that they keep."""
    return DrillPlan(strokes_of(scene), margins_in(scene))


def margins_in(scene: bpy.types.Scene) -> dict[str, float]:
    """The margins that the scene stores."""
    return json.loads(scene.oneframe_ct.margins_text or "{}")


def set_margins(scene: bpy.types.Scene, margins_mm: Mapping[str, float]) -> None:
    """Store the margins in the scene."""
    scene.oneframe_ct.margins_text = json.dumps(dict(margins_mm))


def usual_margins(names: Iterable[str]) -> dict[str, float]:
    """The usual margins of structures; a side at the end of a name does not matter."""
    sideless = {name: name.removesuffix("_left").removesuffix("_right") for name in names}
    return {name: MARGINS_MM[plain] for name, plain in sideless.items() if plain in MARGINS_MM}


def rounded(points: np.ndarray) -> np.ndarray:
    """Points as strokes keep them."""
    return np.round(np.asarray(points, np.float64), DIGITS)
