"""A surface from a grid of points, for everything that is measured on a surface made for it."""

import numpy as np

from oneframe.surface.mesh import TriangleMesh


def grid_mesh(points: np.ndarray) -> TriangleMesh:
    """A triangulated grid of points ``(R, C, 3)``; of a plane grid in x (C) and y (R), the front faces +z."""
    rows, columns = points.shape[:2]
    index = np.arange(rows * columns).reshape(rows, columns)
    a, b, c, d = index[:-1, :-1], index[:-1, 1:], index[1:, 1:], index[1:, :-1]
    faces = np.concatenate([np.stack([a, b, c], -1).reshape(-1, 3), np.stack([a, c, d], -1).reshape(-1, 3)])
    return TriangleMesh(points.reshape(-1, 3), faces.astype(np.int32))
