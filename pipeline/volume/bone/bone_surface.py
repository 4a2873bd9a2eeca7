"""From the voxels of bone to the surface that is written: extracted, smoothed, simplified.

Script and window both call :func:`bone_surface`, so that they give the same surface.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from ...errors import InputError
from ...surface.mesh import MOST_FACES, Ball
from ...transforms import transform_points
from ..volume import Volume, VoxelGrid, box_around
from .bone import CRUMB_MM3, without_crumbs
from .isosurface import Isosurface, RemovedField, isosurface
from .simplification import simplified

Report = Callable[[str, float], None]
"""Called with the name of a stage and its finished share, 0..1; what it raises ends the work."""

STAGES = ("extracted", "smoothed", "simplified")

STEPS = 10
SHRINKING = 0.5
"""Share of the way to the mean of its neighbours that a vertex goes (lambda)."""
PASS_BAND = 0.03
"""Spatial frequency that is kept, of 0 (constant) to 2 (neighbours on opposite sides). A ball of 5 voxels' radius keeps
its volume within 0.2 % in 20 steps; with the customary 0.1 it gains 1.8 %."""

FINER = 4
"""How many times smaller the tolerance is in the part that matters."""


@dataclass(frozen=True)
class Finish:
    """What is done to the surface after it was extracted.

    Attributes
    ----------
    crumb_mm3
        Parts below this volume that the drill has cut off are dropped.
    smoothing_steps
        Steps of :func:`smoothed`; what the drill made is not smoothed.
    tolerance_mm
        How far the simplified surface may lie from the smoothed one, nearly everywhere; 0 keeps all faces.
    focus
        The part that matters, where the tolerance is :data:`FINER` times smaller: by default what was removed.
    """

    crumb_mm3: float = CRUMB_MM3
    smoothing_steps: int = STEPS
    tolerance_mm: float = 0.0
    focus: Ball | None = None


def bone_surface(
    volume: Volume,
    level_hu: float,
    solid: np.ndarray,
    removed: RemovedField | None = None,
    finish: Finish = Finish(),
    *,
    report: Report | None = None,
) -> Isosurface:
    """The surface of bone, closed; ``drilled`` tells the vertices on what was removed.

    Parameters
    ----------
    level_hu
        Bone lies above it.
    solid
        ``(Z, Y, X)`` bool, as of :func:`.bone_voxels`.
    removed
        What was drilled away.
    """
    if removed is not None:
        solid = without_crumbs(solid, volume.grid, removed, smallest_mm3=finish.crumb_mm3)
    surface = isosurface(volume.values, level_hu, volume.grid, solid=solid, removed=removed)
    if report is not None:
        report("extracted", 1.0)
    if len(surface.mesh.faces) == 0:
        raise InputError("surface: expected bone, found none left; remove less")
    surface = smoothed(
        surface, finish.smoothing_steps, progress=None if report is None else partial(report, "smoothed")
    )
    if finish.tolerance_mm > 0:
        surface = _simplified(surface, volume.grid, solid, removed, finish)
        if report is not None:
            report("simplified", 1.0)
    if len(surface.mesh.faces) > MOST_FACES:
        raise InputError(
            f"surface: expected up to {MOST_FACES:,} faces, found {len(surface.mesh.faces):,}; crop the volume, choose "
            "a higher threshold, or a larger tolerance"
        )
    return surface


def moved_mm(grid: VoxelGrid, tolerance_mm: float) -> float:
    """How far the surface of what was removed may lie from its distance field: sampled, smoothed, simplified."""
    return 0.1 * float(grid.spacing_mm.min()) + tolerance_mm / FINER


def widened_mm(margin_mm: float, grid: VoxelGrid, tolerance_mm: float) -> float:
    """The margin in the distance field that leaves ``margin_mm`` on the surface.

    If all corners of a cell keep a distance D from a point, what is interpolated within the cell keeps the root of
    D² - (diagonal / 2)², since the mean of the squared distances from the corners is largest in its middle.
    """
    return moved_mm(grid, tolerance_mm) + float(np.hypot(margin_mm, np.linalg.norm(grid.spacing_mm) / 2))


def removed_ball(grid: VoxelGrid, solid: np.ndarray, removed: RemovedField) -> Ball | None:
    """The ball around the bone that was removed; ``None`` if it was none."""
    taken = taken_bone(solid, removed)
    if not taken.any():
        return None
    first, stop = box_around(taken)
    lower, upper = transform_points(grid.mesh_from_index, removed.first + np.stack([first, stop - 1]))
    return Ball((lower + upper) / 2, float(np.linalg.norm(upper - lower)) / 2)


def taken_bone(solid: np.ndarray, removed: RemovedField) -> np.ndarray:
    """``(z, y, x)`` bool: the voxels of bone that were removed, in the box of the field."""
    return solid[removed.slices] & (removed.distance_mm <= 0)


def _simplified(
    surface: Isosurface, grid: VoxelGrid, solid: np.ndarray, removed: RemovedField | None, finish: Finish
) -> Isosurface:
    focus = finish.focus
    if focus is None and removed is not None:
        focus = removed_ball(grid, solid, removed)
    mesh = simplified(surface.mesh, finish.tolerance_mm, focus, FINER)
    drilled = np.zeros(len(mesh.vertices), np.bool_)
    if removed is not None:
        # the vertices have moved: those that lie on what was removed, as far as the tolerance tells
        drilled = removed.sampled(grid, mesh.vertices, outside=np.inf) < moved_mm(grid, finish.tolerance_mm)
    return Isosurface(mesh, drilled)


def smoothed(surface: Isosurface, steps: int = STEPS, *, progress: Callable[[float], None] | None = None) -> Isosurface:
    """Smooth a closed surface by Taubin's filter; vertices that the drill made stay where they are.

    Each step moves every vertex towards the mean of its neighbours, and then, by the factor mu = 1 / (pass band -
    1 / lambda), away from it, which undoes the shrinking (Taubin, "A signal processing approach to fair surface
    design", SIGGRAPH 1995).

    Parameters
    ----------
    steps
        Pairs of movements; 0 leaves the surface as it is.
    progress
        Called with the finished share, 0..1, after each step; what it raises ends the work.
    """
    mesh = surface.mesh
    count = len(mesh.vertices)
    if steps == 0 or count == 0:
        return surface
    # every edge of a closed surface runs once in each direction: one of its ends is the other's neighbour once
    # as indices of the machine's own size, which are not converted in each step
    vertex = mesh.faces.astype(np.intp).ravel()
    neighbour = np.roll(mesh.faces, -1, axis=1).astype(np.intp).ravel()
    gathered = np.empty(len(vertex))
    neighbours = np.bincount(vertex, minlength=count)
    weight = np.where(surface.drilled, 0.0, 1.0) / neighbours
    middle = mesh.bounds.mean(axis=0)
    # axis by axis: numpy is slow at rows of three
    columns = [np.ascontiguousarray(column) for column in (mesh.vertices - middle).T]
    for step in range(steps):
        for factor in (SHRINKING, 1 / (PASS_BAND - 1 / SHRINKING)):
            for column in columns:
                # "clip" is quicker than a check of every index
                np.take(column, neighbour, out=gathered, mode="clip")
                total = np.bincount(vertex, gathered, minlength=count)
                column += factor * weight * (total - neighbours * column)
        if progress is not None:
            progress((step + 1) / steps)
    vertices = np.stack(columns, axis=1) + middle
    vertices[surface.drilled] = mesh.vertices[surface.drilled]
    return replace(surface, mesh=replace(mesh, vertices=vertices))
