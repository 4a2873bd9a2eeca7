"""The rim of what was drilled: the sharp crease at which its surface meets the bone's own.

Marching cubes puts vertices on the edges of the grid only, so that faces between the two surfaces cut the crease into
saw teeth of one voxel. Here each edge that runs from one surface to the other is split by a vertex where both
surfaces, continued, meet (as feature-sensitive extraction does within a cell: Kobbelt et al., "Feature sensitive
surface extraction from volume data", SIGGRAPH 2001).
"""

from dataclasses import dataclass, replace

import numpy as np

from ..volume import VoxelGrid
from .isosurface import Isosurface, RemovedField

_FLAT = 0.97
"""Cosine of the angle between two normals that meet in no crease to speak of."""

_FARTHEST = 2.0
"""How far a vertex goes from the middle of its edge, in distances of voxels."""

_STEPS = 4
"""Steps of spacing the vertices evenly along the crease."""

_ON_DRILLED = 0.1
"""Distances of voxels within which a vertex lies on what was drilled. Where no crease could be found, it may lie on
bone that the drill did not reach, nearer to a structure than its margin."""

_TRIALS = 6
"""Times that a vertex goes half as far, where a face would turn over."""


@dataclass(frozen=True)
class _Strip:
    """The faces between bone and what was drilled.

    Attributes
    ----------
    faces
        ``(M,)`` their numbers.
    corners
        ``(M, 3)`` vertices, in the order of the face; the first is the one that differs from the other two.
    edges
        ``(N, 2)`` their edges from a vertex of bone to a drilled one.
    split
        ``(M, 2)`` which of them run from the first corner to the second and to the third.
    """

    faces: np.ndarray
    corners: np.ndarray
    edges: np.ndarray
    split: np.ndarray


def with_sharp_rim(surface: Isosurface, removed: RemovedField, grid: VoxelGrid) -> Isosurface:
    """Split the edges between drilled vertices and others on the crease; no other vertex moves.

    The surface is closed, and not smoothed.

    Returns
    -------
    Closed; the vertices on the crease stand behind all others, and count as drilled where they lie on what was.
    """
    strip = _strip(surface)
    if not len(strip.faces):
        return surface
    mesh, made = surface.mesh, surface.drilled
    normals = _one_sided_normals(surface)
    middle = mesh.vertices[strip.edges].mean(axis=1)
    crease = _crease(surface, strip, normals, removed, grid)
    new = strip.split + len(made)
    apex, first, second = strip.corners.T
    cut = np.concatenate([
        np.stack([apex, *new.T], axis=1),
        np.stack([new[:, 0], first, second], axis=1),
        np.stack([new[:, 0], second, new[:, 1]], axis=1),
    ])  # fmt: skip
    front = np.concatenate([normals[apex], normals[first] + normals[second], normals[second]])
    share = np.ones((len(middle), 1))
    for trial in range(_TRIALS):
        vertices = np.concatenate([mesh.vertices, middle + share * (crease - middle)])
        one, two, three = (vertices[corner] for corner in cut.T)
        turned = np.einsum("ij,ij->i", np.cross(two - one, three - one), front) < 0
        back = strip.split[turned.reshape(3, -1).any(axis=0)].ravel()
        share[back] = share[back] / 2 if trial < _TRIALS - 2 else 0
    faces = np.concatenate([np.delete(mesh.faces, strip.faces, axis=0), cut.astype(mesh.faces.dtype)])
    rest = _rest(vertices[len(made) :], removed, grid)
    drilled = np.concatenate([made, np.abs(rest) < _ON_DRILLED * float(grid.spacing_mm.min())])
    return Isosurface(replace(mesh, vertices=vertices, faces=faces), drilled)


def _strip(surface: Isosurface) -> _Strip:
    made, faces = surface.drilled, surface.mesh.faces
    corners_made = made[faces].sum(axis=1)
    mixed = np.flatnonzero((corners_made == 1) | (corners_made == 2))
    odd = np.argmax(made[faces[mixed]] == (corners_made[mixed] == 1)[:, None], axis=1)
    corners = np.take_along_axis(faces[mixed], (odd[:, None] + np.arange(3)) % 3, axis=1).astype(np.int64)
    ends = np.sort(corners[:, [[0, 1], [0, 2]]].reshape(-1, 2), axis=1)
    key, split = np.unique(ends[:, 0] * len(made) + ends[:, 1], return_inverse=True)
    edges = np.stack([key // len(made), key % len(made)], axis=1)
    edges = np.where(made[edges[:, :1]], edges[:, ::-1], edges)
    return _Strip(mixed, corners, edges, split.reshape(-1, 2))


def _crease(
    surface: Isosurface, strip: _Strip, normals: np.ndarray, removed: RemovedField, grid: VoxelGrid
) -> np.ndarray:
    """``(N, 3)`` points of the crease for the edges of the strip; those that cross none follow their neighbours."""
    start, end = (surface.mesh.vertices[vertex] for vertex in strip.edges.T)
    n, m = (normals[vertex] for vertex in strip.edges.T)
    cosine = np.einsum("ij,ij->i", n, m)
    sharp = (np.abs(cosine) < _FLAT) & (n != 0).any(axis=1) & (m != 0).any(axis=1)
    determinant = np.where(sharp, 1 - cosine * cosine, 1.0)
    spacing = float(grid.spacing_mm.max())

    def onto_both(points: np.ndarray, above_drilled: np.ndarray) -> np.ndarray:
        """The nearest points on the bone's plane, and on the drilled one, from ``above_drilled`` (N,) mm above it."""
        above = np.einsum("ij,ij->i", n, points - start)
        along_n, along_m = above - cosine * above_drilled, above_drilled - cosine * above
        return points - (along_n[:, None] * n + along_m[:, None] * m) / determinant[:, None]

    def within_reach(points: np.ndarray) -> np.ndarray:
        away = points - middle
        length = np.linalg.norm(away, axis=1, keepdims=True)
        return middle + away * np.minimum(1, _FARTHEST * spacing / np.maximum(length, spacing / 1e3))

    middle = (start + end) / 2
    met = onto_both(middle, np.einsum("ij,ij->i", m, middle - end))
    points = within_reach(np.where(sharp[:, None], met, middle))
    pair = np.concatenate([strip.split, strip.split[:, ::-1]])
    count = np.bincount(pair[:, 0], minlength=len(middle))
    for _ in range(_STEPS):
        total = np.stack([np.bincount(pair[:, 0], each[pair[:, 1]], len(middle)) for each in points.T], axis=1)
        points = (points + total / count[:, None]) / 2
        # the field is that of the drill itself, and no plane
        rest = _rest(points, removed, grid)
        met = onto_both(points, -np.clip(rest, -spacing, spacing))
        points = within_reach(np.where(sharp[:, None], met, points))
    return points


def _rest(points: np.ndarray, removed: RemovedField, grid: VoxelGrid) -> np.ndarray:
    """``(N,)`` mm from what was drilled, as far as the field tells; 0 outside its box."""
    return removed.sampled(grid, points, outside=0.0)


def _one_sided_normals(surface: Isosurface) -> np.ndarray:
    """``(V, 3)`` unit normals of the faces around a vertex and its neighbours, on its side of the rim; 0 of none."""
    mesh, made = surface.mesh, surface.drilled
    corners_made = made[mesh.faces].sum(axis=1)
    pure = (corners_made == 0) | (corners_made == 3)
    faces = mesh.faces[pure]
    total = _gathered(_gathered(mesh.face_cross[pure], faces, len(made))[faces].sum(axis=1), faces, len(made))
    length = np.linalg.norm(total, axis=1, keepdims=True)
    return np.divide(total, length, out=np.zeros_like(total), where=length > 0)


def _gathered(of_faces: np.ndarray, faces: np.ndarray, count: int) -> np.ndarray:
    """``(count, 3)`` sums of the faces around each vertex."""
    return np.stack([np.bincount(faces.ravel(), np.repeat(each, 3), minlength=count) for each in of_faces.T], axis=1)
