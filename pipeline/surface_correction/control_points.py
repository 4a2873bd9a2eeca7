"""Points on a surface that move along its normals, and take its vertices along."""

from dataclasses import dataclass, replace

import numpy as np
from scipy import sparse
from scipy.spatial import cKDTree

from ..surface.mesh import TriangleMesh, distinct_points

SMOOTHED = 10
"""Rounds in which the normals are averaged with their neighbours': so neighbours do not cross when they move."""
NEIGHBOURS = 8
THINNED, WIDTH = 0.75, 0.7
"""Relative to the spacing: least distance of two points, and standard deviation of the weight that one has."""
LEAST_WEIGHT = 0.05
"""Of a point right at the place: below it, it has none, and a vertex without any stays."""


@dataclass(frozen=True)
class ControlPoints:
    """M points of a surface with V vertices.

    Attributes
    ----------
    mesh
        The surface before it moves, model frame, mm.
    normals
        ``(V, 3)`` unit directions in which the vertices move.
    places
        ``(M, 3)`` the points, mm.
    weights
        ``(V, M)`` sparse: what each vertex takes of each point's displacement.
    bending
        ``(M, M)`` sparse: each point's displacement less the mean of its neighbours'.
    """

    mesh: TriangleMesh
    normals: np.ndarray
    places: np.ndarray
    weights: sparse.csr_matrix
    bending: sparse.csr_matrix

    @classmethod
    def of(cls, mesh: TriangleMesh, seen: np.ndarray, spacing_mm: float) -> "ControlPoints":
        """Spread points over the vertices that are seen, ``(V,)`` bool, about ``spacing_mm`` apart."""
        normals = _smooth_normals(mesh)
        numbers = np.flatnonzero(seen)
        cells = np.floor(mesh.vertices[numbers] / spacing_mm).astype(np.int64)
        _, first = np.unique(cells, axis=0, return_index=True)
        numbers = numbers[np.sort(first)]
        kept = np.ones(len(numbers), bool)
        for one, other in sorted(cKDTree(mesh.vertices[numbers]).query_pairs(THINNED * spacing_mm)):
            kept[other] &= not kept[one]
        places, directions = mesh.vertices[numbers[kept]], normals[numbers[kept]]
        near, points = min(NEIGHBOURS, len(places) - 1), (places, directions)
        weights = _means(mesh.vertices, normals, points, spacing_mm, slice(0, near))
        means = _means(places, directions, points, spacing_mm, slice(1, near + 1))
        return cls(mesh, normals, places, weights, sparse.identity(len(places), format="csr") - means)

    def moved(self, heights_mm: np.ndarray) -> TriangleMesh:
        """The surface with its points ``(M,)`` mm along the normals."""
        return replace(self.mesh, vertices=self.mesh.vertices + self.normals * (self.weights @ heights_mm)[:, None])


def neighbour_means(mesh: TriangleMesh) -> sparse.csr_matrix:
    """``(V, V)`` sparse: the mean of a vertex and of its neighbours; vertices at one place are one."""
    places, index = distinct_points(mesh.vertices)
    corners = index[mesh.faces]
    start, end = corners.ravel(), corners[:, (1, 2, 0)].ravel()
    edges = sparse.coo_matrix((np.ones(len(start)), (start, end)), (len(places),) * 2).tocsr()
    edges = edges + edges.T + sparse.identity(len(places))
    edges.data[:] = 1
    means = sparse.diags(1 / np.asarray(edges.sum(axis=1)).ravel()) @ edges
    split = sparse.csr_matrix((np.ones(len(index)), (np.arange(len(index)), index)), (len(index), len(places)))
    joined = sparse.diags(1 / np.asarray(split.sum(axis=0)).ravel()) @ split.T
    return (split @ means @ joined).tocsr()


def _smooth_normals(mesh: TriangleMesh) -> np.ndarray:
    means, normals = neighbour_means(mesh), mesh.smooth_normals
    for _ in range(SMOOTHED):
        normals = means @ normals
        normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
    return normals


def _means(
    at: np.ndarray, normals: np.ndarray, points: tuple[np.ndarray, np.ndarray], spacing_mm: float, chosen: slice
) -> sparse.csr_matrix:
    """``(N, M)`` sparse: weighted means over the ``chosen`` nearest of M points with their normals, at N places."""
    places, directions = points
    apart, nearest = (each[:, chosen] for each in cKDTree(places).query(at, k=chosen.stop))
    weight = np.exp(-0.5 * (apart / (WIDTH * spacing_mm)) ** 2)
    weight[weight < LEAST_WEIGHT] = 0
    # those across an edge count little
    weight *= np.maximum(np.einsum("ni,nki->nk", normals, directions[nearest]), 0) ** 2
    weight /= np.maximum(weight.sum(axis=1, keepdims=True), 1e-12)
    row = np.repeat(np.arange(len(at)), weight.shape[1])
    found = sparse.csr_matrix((weight.ravel(), (row, nearest.ravel())), (len(at), len(places)))
    found.eliminate_zeros()
    return found
