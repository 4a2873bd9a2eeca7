"""Reduce a mesh to the detail that an image can show, by merging the vertices in each cell of a grid.

Source: Rossignac & Borrel, "Multi-resolution 3D approximations for rendering complex scenes" (1993).
"""

import numpy as np

from .mesh import TriangleMesh


def cluster_vertices(mesh: TriangleMesh, cell_mm: float) -> TriangleMesh:
    """Merge all vertices in a cubic cell to their mean; faces that lose an edge are dropped.

    The surface moves by less than the diagonal of a cell. If no face would remain, the mesh is unchanged.
    """
    cell = np.floor((mesh.vertices - mesh.bounds[0]) / cell_mm).astype(np.int64)
    extent = cell.max(axis=0) + 1
    _, cluster = np.unique((cell[:, 0] * extent[1] + cell[:, 1]) * extent[2] + cell[:, 2], return_inverse=True)
    cluster = cluster.reshape(-1)
    faces = cluster[mesh.faces]
    faces = faces[(faces != np.roll(faces, 1, axis=1)).all(axis=1)]
    if len(faces) == 0:
        return mesh
    sums = np.stack([np.bincount(cluster, column) for column in mesh.vertices.T], axis=1)
    return TriangleMesh(sums / np.bincount(cluster)[:, None], faces.astype(np.int32))


def reduced_mesh(mesh: TriangleMesh, most_vertices: int) -> TriangleMesh:
    """A mesh of at most this many vertices, evenly spread and all used by faces, or the mesh itself.

    It stays as it is if it has no more vertices, or if so few would leave no face.
    """
    if len(mesh.vertices) <= most_vertices:
        return mesh
    # as if every vertex stood for a square
    cell_mm = float(np.sqrt(np.linalg.norm(mesh.face_cross, axis=1).sum() / 2 / most_vertices))
    while True:
        reduced = cluster_vertices(mesh, cell_mm)
        if reduced is mesh:
            return mesh
        used, corners = np.unique(reduced.faces, return_inverse=True)
        if len(used) <= most_vertices:
            return TriangleMesh(reduced.vertices[used], corners.reshape(-1, 3).astype(np.int32))
        cell_mm *= 1.05
