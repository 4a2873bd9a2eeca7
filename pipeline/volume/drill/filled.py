"""Which voxels lie inside a closed mesh: rows of voxels along x, and how often the surface crosses each."""

import numpy as np

from ...errors import InputError
from ...surface.mesh import TriangleMesh
from ...transforms import transform_points
from ..volume import VoxelGrid

_PAIRS = 1 << 20
"""Pairs of a triangle and a row that are looked at together, which bounds the memory."""

_SHIFT = np.array([0.0, np.pi, np.e]) * 1e-7
"""Voxels: so that no row of the grid on which a mesh was made runs through its vertices."""


def filled(mesh: TriangleMesh, grid: VoxelGrid) -> tuple[np.ndarray, np.ndarray]:
    """The voxels of a grid whose centres lie inside a closed mesh (LPS, mm).

    Returns
    -------
    The first voxel ``(3,)`` (x, y, z) of the box that holds them, and ``(z, y, x)`` bool; empty outside the grid.
    """
    points = transform_points(grid.index_from_mesh, mesh.vertices) + _SHIFT
    first = np.clip(np.ceil(points.min(axis=0)), 0, grid.size).astype(np.int64)
    stop = np.maximum(np.clip(np.floor(points.max(axis=0)) + 1, 0, grid.size).astype(np.int64), first)
    width, height, depth = (int(count) for count in stop - first)
    if not width * height * depth:
        return first, np.zeros((0, 0, 0), np.bool_)
    points -= first
    # the last column counts what lies beyond the box
    crossed = np.zeros((depth * height, width + 1), np.uint8)
    corners = points[mesh.faces][:, :, 1:]
    low = np.maximum(np.ceil(corners.min(axis=1)), 0).astype(np.int64)
    high = np.minimum(np.floor(corners.max(axis=1)), [height - 1, depth - 1]).astype(np.int64)
    extent = np.maximum(high - low + 1, 0)
    count = extent[:, 0] * extent[:, 1]
    ends = np.cumsum(count)
    face = 0
    while face < len(count):
        done = int(ends[face - 1]) if face else 0
        last = max(int(np.searchsorted(ends, done + _PAIRS)), face + 1)
        owner = np.repeat(np.arange(face, last), count[face:last])
        place = np.arange(len(owner)) - (ends - count)[owner] + done
        y, z = low[owner, 0] + place % extent[owner, 0], low[owner, 1] + place // extent[owner, 0]
        hit, x = _crossings(points, mesh.faces[owner], y, z)
        column = np.clip(np.ceil(x), 0, width).astype(np.int64)
        np.bitwise_xor.at(crossed.reshape(-1), (z[hit] * height + y[hit]) * (width + 1) + column, 1)
        face = last
    parity = np.bitwise_xor.accumulate(crossed, axis=1)
    if parity[:, -1].any():
        raise InputError("structure: expected a closed mesh, found one with holes; close them")
    return first, np.ascontiguousarray(parity[:, :-1]).reshape(depth, height, width).view(np.bool_)


def _crossings(points: np.ndarray, faces: np.ndarray, y: np.ndarray, z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Which of the rows along x at (y, z) cross triangles ``(N, 3)``, as indices, and at what x."""
    weights, left = [], []
    for a, b in ((1, 2), (2, 0), (0, 1)):
        # always from the vertex of the lower number, so that both faces of an edge agree to the last bit
        i, j = faces[:, a], faces[:, b]
        p, q = points[np.minimum(i, j)], points[np.maximum(i, j)]
        area = (q[:, 1] - p[:, 1]) * (z - p[:, 2]) - (q[:, 2] - p[:, 2]) * (y - p[:, 1])
        weights.append(np.where(i < j, area, -area))
        left.append((area >= 0) ^ (i > j))
    hit = np.flatnonzero((left[0] == left[1]) & (left[1] == left[2]))
    share = np.stack([weight[hit] for weight in weights], axis=1)
    total = share.sum(axis=1)
    total[total == 0] = 1.0
    return hit, np.einsum("nk,nk->n", share, points[faces[hit], 0]) / total
