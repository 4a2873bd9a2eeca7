"""From a CT to the surface of its bone, drilled or not, and of the structures in it: for the command and the window."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from ..surface.mesh import Ball, TriangleMesh
from ..surface.structure_colour import OTHER, structure_colour
from .bone.bone_surface import STEPS, BoneSurface, Finish, Report, bone_surface, removed_ball, taken_bone, widened_mm
from .bone.isosurface import RemovedField
from .bone.structures import structure_meshes
from .bone.subtraction import removed_by_labels, united
from .drill.drill_plan import DrillPlan
from .drill.virtual_drill import removed_by_plan
from .volume import LabelMap, Volume, VoxelGrid

STRUCTURES_STAGE = "of the structures"
"""The name of the first stage, before those of :data:`.STAGES`."""


@dataclass(frozen=True)
class SurfaceSettings:
    """What is taken away from the bone, in any of two ways, and how the surface is finished.

    Attributes
    ----------
    plan
        Strokes of a virtual drill, and margins around structures, which hold on the finished surface.
    taken
        A map: all that has a label.
    tolerance_mm, smoothing_steps
        Of :class:`.Finish`; the tolerance is half the smallest distance of voxels if it is ``None``.
    """

    plan: DrillPlan | None = None
    taken: LabelMap | None = None
    tolerance_mm: float | None = None
    smoothing_steps: int = STEPS


@dataclass(frozen=True)
class MadeSurface:
    """The surface of the bone, and what it was made of.

    Attributes
    ----------
    bone
        The surface.
    structures
        Meshes by name.
    removed
        All that was taken away; ``None`` for nothing.
    removed_by
        The ways in which it was.
    removed_mm3, removed_share
        How much bone that is, and of all bone, 0..1.
    finish
        How the surface was smoothed and simplified.
    """

    bone: BoneSurface
    structures: Mapping[str, TriangleMesh]
    removed: RemovedField | None
    removed_by: tuple[str, ...]
    removed_mm3: float
    removed_share: float
    finish: Finish


def make_surface(
    volume: Volume,
    level_hu: float,
    solid: np.ndarray,
    labels: LabelMap | None,
    settings: SurfaceSettings,
    *,
    report: Report | None = None,
) -> MadeSurface:
    """Make the surface of bone and the structures.

    Parameters
    ----------
    volume, level_hu, solid
        The CT; bone lies above the level; its voxels ``(Z, Y, X)`` bool, as of :func:`.bone_voxels`.
    labels
        The structures, without bone.
    settings
        What is taken away, and how the surface is finished.
    report
        Called with the name of each stage and its share.
    """
    structures = {}
    if labels is not None:
        structures = structure_meshes(labels, progress=None if report is None else partial(report, STRUCTURES_STAGE))
    fields: dict[str, RemovedField | None] = {}
    if settings.plan is not None:
        fields["drill"] = removed_of(settings.plan, volume, structures, tolerance_mm=settings.tolerance_mm)
    if settings.taken is not None:
        fields["labels"] = removed_by_labels(settings.taken, volume.grid)
    ways = {way: field for way, field in fields.items() if field is not None}
    removed = united(list(ways.values()))
    finish = finish_of(
        volume,
        solid,
        removed,
        structures,
        tolerance_mm=settings.tolerance_mm,
        smoothing_steps=settings.smoothing_steps,
    )
    bone = bone_surface(volume, level_hu, solid, removed, finish, report=report)
    taken = 0 if removed is None else int(taken_bone(solid, removed).sum())
    share = taken / max(int(solid.sum()), 1)
    return MadeSurface(bone, structures, removed, tuple(ways), taken * volume.grid.voxel_mm3, share, finish)


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
    """What a plan removes, so that the margins hold on the finished surface; ``None`` without strokes."""
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
