"""From a CT to the surface of its bone, drilled or not, and of the structures in it: for the command and the window."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from ..surface.mesh import Ball, TriangleMesh
from ..surface.structure_colour import OTHER, structure_colour
from .bone.bone_surface import STEPS, Finish, Report, bone_surface, removed_ball, taken_bone, widened_mm
from .bone.isosurface import Isosurface, RemovedField
from .bone.structures import structure_meshes
from .drill.drill_plan import DrillPlan
from .drill.virtual_drill import FAR_MM, removed_by_plan
from .simple_itk import resampled
from .volume import LabelMap, Volume, VoxelGrid, box_around, box_slices

STRUCTURES_STAGE = "of the structures"
"""The name of the first stage, before those of :data:`.STAGES`."""

_SLOPE = 0.5
"""Slope at the border of a mask averaged over a voxel and its neighbours: its share of a voxel per voxel."""

_MARGIN = 3


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

    bone: Isosurface
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


def removed_by_labels(labels: LabelMap, grid: VoxelGrid) -> RemovedField:
    """The field of the voxels with a label, on the grid of a volume.

    The mask is averaged with the weights 1/4, 1/2, 1/4 along each axis, and the removed part ends where a half is left.
    """
    mask = labels.values > 0
    low, high = box_around(mask)
    share = np.pad(mask[box_slices(low, high)].astype(np.float32), _MARGIN)
    for axis in range(3):
        share = np.moveaxis(share, axis, 0)
        share[1:-1] = share[:-2] / 4 + share[1:-1] / 2 + share[2:] / 4
        share = np.moveaxis(share, 0, axis)
    depth, height, width = share.shape
    own = labels.grid.shifted(low - _MARGIN, (width, height, depth))
    first, stop = grid.box_of(own.corners_mm, "removed part")
    part = grid.shifted(first, tuple(int(count) for count in stop - first))  # type: ignore[arg-type]
    inside = resampled(share, own, part)
    return RemovedField(first, (np.float32(0.5) - inside) * np.float32(labels.grid.spacing_mm.mean() / _SLOPE))


def united(fields: Sequence[RemovedField]) -> RemovedField | None:
    """The field of what any of several removed; ``None`` of none."""
    if len(fields) < 2:
        return fields[0] if fields else None
    first = np.min([field.first for field in fields], axis=0)
    stop = np.max([field.first + field.distance_mm.shape[::-1] for field in fields], axis=0)
    distance = np.full((stop - first)[::-1], FAR_MM, np.float32)
    for field in fields:
        at = field.first - first
        part = distance[box_slices(at, at + field.distance_mm.shape[::-1])]
        np.minimum(part, field.distance_mm, out=part)
    return RemovedField(first, distance)
