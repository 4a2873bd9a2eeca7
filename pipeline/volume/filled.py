"""Which voxels lie inside a closed mesh: the crossings of each row of voxels with the triangles, counted."""

import numpy as np

from ..errors import InputError
from ..surface.mesh import TriangleMesh
from ..transforms import transform_points
from .volume import VoxelGrid

_SHIFTS = ((1.07e-5, 2.13e-5), (-3.01e-5, 1.39e-5), (2.23e-5, -4.19e-5), (-1.73e-5, -2.89e-5))
"""Of the rows, in voxels, tried in turn: a row may run exactly through an edge."""

_CHUNK = 1 << 18
"""Triangles at a time."""


def filled(mesh: TriangleMesh, grid: VoxelGrid) -> tuple[np.ndarray, np.ndarray]:
    """The voxels of a grid whose centres lie inside a closed mesh (LPS, mm).

    Returns
    -------
    The first voxel ``(3,)`` (x, y, z) of the box that holds them, and ``(z, y, x)`` bool; empty outside the grid.

    Raises
    ------
    InputError
        The mesh is not closed.
    """
    index = transform_points(grid.index_from_mesh, mesh.vertices)
    first = np.maximum(np.floor(index.min(axis=0)), 0).astype(int)
    stop = np.minimum(np.ceil(index.max(axis=0)) + 1, grid.size).astype(int)
    if (stop <= first).any():
        return first, np.zeros((0, 0, 0), np.bool_)
    for shift in _SHIFTS:
        # the last column counts what lies beyond the box
        crossings = np.zeros([*(stop - first)[:0:-1], stop[0] - first[0] + 1], np.int32)
        for at in range(0, len(mesh.faces), _CHUNK):
            _count(index, mesh.faces[at : at + _CHUNK], first, crossings, shift)
        if not (crossings.sum(axis=2) & 1).any():
            return first, (np.cumsum(crossings[:, :, :-1], axis=2) & 1).astype(np.bool_)
    raise InputError("structure: expected a closed mesh, found one with holes; close them")


def _count(
    index: np.ndarray, faces: np.ndarray, first: np.ndarray, crossings: np.ndarray, shift: tuple[float, float]
) -> None:
    """Add the crossings of rows along x with triangles, at the first voxel behind each."""
    a, b, c = (index[faces[:, corner]] - first for corner in range(3))
    rows = np.array(crossings.shape[1::-1])
    low = np.maximum(np.ceil(np.minimum(np.minimum(a, b), c)[:, 1:] - shift), 0).astype(np.int64)
    high = np.minimum(np.floor(np.maximum(np.maximum(a, b), c)[:, 1:] - shift), rows - 1).astype(np.int64)
    extent = np.maximum(high - low + 1, 0)
    count = extent[:, 0] * extent[:, 1]
    owner = np.repeat(np.arange(len(faces)), count)
    place = np.arange(len(owner)) - np.repeat(np.cumsum(count) - count, count)
    y = low[owner, 0] + place % extent[owner, 0]
    z = low[owner, 1] + place // extent[owner, 0]
    py, pz = y + shift[0], z + shift[1]
    weights = []
    for p, q in ((b, c), (c, a), (a, b)):
        p, q = p[owner], q[owner]
        weights.append((q[:, 1] - p[:, 1]) * (pz - p[:, 2]) - (q[:, 2] - p[:, 2]) * (py - p[:, 1]))
    wa, wb, wc = weights
    inside = ((wa > 0) & (wb > 0) & (wc > 0)) | ((wa < 0) & (wb < 0) & (wc < 0))
    owner, y, z = owner[inside], y[inside], z[inside]
    wa, wb, wc = wa[inside], wb[inside], wc[inside]
    x = (wa * a[owner, 0] + wb * b[owner, 0] + wc * c[owner, 0]) / (wa + wb + wc)
    column = np.clip(np.ceil(x), 0, crossings.shape[2] - 1).astype(np.int64)
    np.add.at(crossings, (z, y, column), 1)
