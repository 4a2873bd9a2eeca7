"""How a surface is smoothed and simplified unless the user says otherwise: the same for the command and the window."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from ..case.structure_colour import OTHER, structure_colour
from ..surface.ball import Ball
from ..surface.mesh import TriangleMesh
from ..volume.bone.bone_surface import Finish, removed_ball, widened_mm
from ..volume.bone.isosurface import RemovedField
from ..volume.bone.smoothing import STEPS
from ..volume.drill.drill_plan import DrillPlan
from ..volume.drill.virtual_drill import removed_by_plan
from ..volume.volume import Volume, VoxelGrid


def finish_of(
    volume: Volume,
    solid: np.ndarray,
    removed: RemovedField | None,
    structures: Mapping[str, TriangleMesh],
    *,
    tolerance_mm: float | None = None,
    smoothing_steps: int = STEPS,
) -> Finish:
    """The finish of a surface; ``tolerance_mm`` is half the smallest distance of voxels if it is ``None``."""
    tolerance = _tolerance(volume.grid, tolerance_mm)
    focus = _focus(volume, solid, removed, structures)
    return Finish(smoothing_steps=smoothing_steps, tolerance_mm=tolerance, focus=focus)


def removed_of(
    plan: DrillPlan, volume: Volume, structures: Mapping[str, TriangleMesh], *, tolerance_mm: float | None = None
) -> RemovedField | None:
    """What a plan removes, so that the margins hold on the finished surface; ``None`` without strokes.

    Raises
    ------
    InputError
        As for :func:`.removed_by_plan`.
    """
    grid, tolerance = volume.grid, _tolerance(volume.grid, tolerance_mm)
    margins = {name: widened_mm(margin, grid, tolerance) for name, margin in plan.margins_mm.items()}
    return removed_by_plan(replace(plan, margins_mm=margins), grid, structures)


def _tolerance(grid: VoxelGrid, tolerance_mm: float | None) -> float:
    return float(grid.spacing_mm.min()) / 2 if tolerance_mm is None else tolerance_mm


def _focus(
    volume: Volume, solid: np.ndarray, removed: RemovedField | None, structures: Mapping[str, TriangleMesh]
) -> Ball | None:
    """The part that matters: what was removed, or else where the structures are that have a colour of their own."""
    if removed is not None and (ball := removed_ball(volume.grid, solid, removed)) is not None:
        return ball
    shown = [mesh.vertices for name, mesh in structures.items() if structure_colour(name) != OTHER]
    if not shown:
        return None
    points = np.concatenate(shown)
    lower, upper = points.min(axis=0), points.max(axis=0)
    return Ball((lower + upper) / 2, float(np.linalg.norm(upper - lower)) / 2)
