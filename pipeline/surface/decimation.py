"""Reduce a mesh to the detail that an image can show, by merging the vertices in each cell of a grid.

Source: Rossignac & Borrel, "Multi-resolution 3D approximations for rendering complex scenes" (1993).
"""

import numpy as np

from .mesh import TriangleMesh


def cluster_vertices(
    mesh: TriangleMesh, cell_mm: float, colours: np.ndarray | None = None
) -> tuple[TriangleMesh, np.ndarray | None]:
    """Merge all vertices in a cell to their mean; faces that lose an edge are dropped.

    Parameters
    ----------
    cell_mm
        Side of the cubic cells; the surface moves by less than their diagonal.
    colours
        ``(V, 3)`` per vertex, averaged as the vertices are, or ``None``.

    Returns
    -------
    The reduced mesh and its colours. If no face would remain, the mesh and its colours unchanged.
    """
    cell = np.floor((mesh.vertices - mesh.bounds[0]) / cell_mm).astype(np.int64)
    extent = cell.max(axis=0) + 1
    _, cluster = np.unique((cell[:, 0] * extent[1] + cell[:, 1]) * extent[2] + cell[:, 2], return_inverse=True)
    cluster = cluster.reshape(-1)
    faces = cluster[mesh.faces]
    faces = faces[(faces != np.roll(faces, 1, axis=1)).all(axis=1)]
    if len(faces) == 0:
        return mesh, colours
    count = np.bincount(cluster)[:, None]

    def mean(values: np.ndarray) -> np.ndarray:
        return np.stack([np.bincount(cluster, column) for column in values.T], axis=1) / count

    reduced = TriangleMesh(mean(mesh.vertices), faces.astype(np.int32))
    return reduced, None if colours is None else mean(colours)


def reduced_mesh(mesh: TriangleMesh, most_vertices: int) -> TriangleMesh:
    """A mesh of at most this many vertices, evenly spread and all used by faces, or the mesh itself.

    It stays as it is if it has no more vertices, or if so few would leave no face.
    """
    if len(mesh.vertices) <= most_vertices:
        return mesh
    # as if every vertex stood for a square
    cell_mm = float(np.sqrt(np.linalg.norm(mesh.face_cross, axis=1).sum() / 2 / most_vertices))
    while True:
        reduced, _ = cluster_vertices(mesh, cell_mm)
        if reduced is mesh:
            return mesh
        used, corners = np.unique(reduced.faces, return_inverse=True)
        if len(used) <= most_vertices:
            return TriangleMesh(reduced.vertices[used], corners.reshape(-1, 3).astype(np.int32))
        cell_mm *= 1.05
