"""Smoothing that takes the noise of the scanner off a surface and does not shrink it."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from .isosurface import Isosurface

STEPS = 10
SHRINKING = 0.5
"""Share of the way to the mean of its neighbours that a vertex goes (lambda)."""
PASS_BAND = 0.03
"""Spatial frequency that is kept, of 0 (constant) to 2 (neighbours on opposite sides). A ball of 5 voxels' radius keeps
its volume within 0.2 % in 20 steps; with the customary 0.1 it gains 1.8 %."""


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
