"""Which voxels lie inside a closed mesh: rays along x through all rows of voxels, counted by their parity."""

import numpy as np

from ..surface.mesh import TriangleMesh
from .drill_plan import index_points
from .volume import VoxelGrid

_BLOCK = 1 << 20
"""Pairs of a triangle and a ray that are looked at together, which bounds the memory."""

_SHIFT = np.array([0.0, np.pi, np.e]) * 1e-7
"""Voxels: so that no ray of the grid on which a mesh was made meets its vertices."""


def inside_mesh(mesh: TriangleMesh, grid: VoxelGrid) -> tuple[np.ndarray, np.ndarray]:
    """The voxels inside a closed mesh.

    Returns
    -------
    ``(3,)`` the first voxel (x, y, z) of the box around the mesh, as far as it lies in the volume, and ``(z, y, x)``
    bool for the box.
    """
    points = index_points(grid, mesh.vertices) + _SHIFT
    first = np.clip(np.ceil(points.min(axis=0)), 0, grid.size).astype(np.int64)
    stop = np.maximum(np.clip(np.floor(points.max(axis=0)) + 1, 0, grid.size).astype(np.int64), first)
    width, height, depth = (int(count) for count in stop - first)
    if not width * height * depth:
        return first, np.zeros((depth, height, width), np.bool_)
    points -= first
    # as by the surface: how often the row of voxels has been crossed before each of them
    crossed = np.zeros((height * depth, width + 1), np.uint8)
    corners = points[mesh.faces]
    low = np.clip(np.ceil(corners[:, :, 1:].min(axis=1)), 0, None).astype(np.int64)
    high = np.minimum(np.floor(corners[:, :, 1:].max(axis=1)), [height - 1, depth - 1]).astype(np.int64)
    count = np.maximum(high - low + 1, 0)
    rays = count[:, 0] * count[:, 1]
    ends = np.cumsum(rays)
    start = 0
    while start < len(rays):
        done = ends[start - 1] if start else 0
        stop_face = max(int(np.searchsorted(ends, done + _BLOCK)), start + 1)
        faces = np.arange(start, stop_face)
        face = np.repeat(faces, rays[faces])
        place = np.arange(len(face)) - np.repeat(ends[faces] - rays[faces] - done, rays[faces])
        y = low[face, 0] + place % count[face, 0]
        z = low[face, 1] + place // count[face, 0]
        hit, x = _crossings(points, mesh.faces[face], y, z)
        column = np.clip(np.ceil(x), 0, width).astype(np.int64)
        np.bitwise_xor.at(crossed.reshape(-1), (z[hit] * height + y[hit]) * (width + 1) + column, 1)
        start = stop_face
    parity = np.bitwise_xor.accumulate(crossed, axis=1)[:, :-1]
    return first, parity.reshape(depth, height, width).view(np.bool_)


def _crossings(points: np.ndarray, faces: np.ndarray, y: np.ndarray, z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Where rays along x at (y, z) cross triangles ``(N, 3)``: indices of those that do, and their x."""
    weights, left = [], []
    for a, b in ((1, 2), (2, 0), (0, 1)):
        # always from the lower vertex to the higher, so that the two faces of an edge agree to the last bit
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
