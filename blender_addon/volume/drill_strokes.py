"""What was drilled: strokes and margins in the scene's settings, which undo, files and the case rely on."""

import json
from collections.abc import Sequence

import bpy
import numpy as np

from ..pipeline.volume.drill_plan import DrillPlan, Stroke
from ..pipeline.volume.isosurface import RemovedField
from .loaded import LoadedCT

DIGITS = 3
"""Decimals of a millimetre that strokes keep: window, case and script have the same numbers."""


def strokes_of(scene: bpy.types.Scene) -> tuple[Stroke, ...]:
    """The strokes, in the order of drilling."""
    text = scene.oneframe_ct.strokes_text
    return tuple(Stroke(radius, np.array(points, np.float64)) for radius, points in json.loads(text or "[]"))


def set_strokes(scene: bpy.types.Scene, strokes: Sequence[Stroke]) -> None:
    """Store the strokes in the scene."""
    rows = [[stroke.radius_mm, stroke.points.tolist()] for stroke in strokes]
    scene.oneframe_ct.strokes_text = json.dumps(rows, separators=(",", ":")) if rows else ""


def plan_of(scene: bpy.types.Scene) -> DrillPlan:
    """Strokes, and the margins that they keep."""
    return DrillPlan(strokes_of(scene), json.loads(scene.oneframe_ct.margins_text or "{}"))


def rounded(points: np.ndarray) -> np.ndarray:
    """Points as strokes keep them."""
    return np.round(np.asarray(points, np.float64), DIGITS)


def removed_by(plan: DrillPlan, ct: LoadedCT, level_hu: float, solid: np.ndarray) -> RemovedField | None:
    """What a plan removes, as ``oneframe surface --drill`` does; ``None`` for a plan without strokes."""
    if not plan.strokes:
        return None
    from ..pipeline.volume.drilled_volume import DrilledVolume

    drilled = DrilledVolume(ct.volume, level_hu, solid, {})
    for stroke in plan.strokes:
        drilled.add(stroke)
    return drilled.removed
