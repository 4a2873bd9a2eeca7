"""Distances from a surface against brute force by another library."""

import numpy as np
import trimesh
from hypothesis import given
from hypothesis import strategies as st

from oneframe.surface.deviation import deviation
from oneframe.surface.mesh import TriangleMesh


def _brute_force(points: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """``(N, F)`` distances of all points from all triangles."""
    pairs = np.repeat(triangles[None], len(points), axis=0).reshape(-1, 3, 3)
    repeated = np.repeat(points, len(triangles), axis=0)
    nearest = trimesh.triangles.closest_point(pairs, repeated)
    return np.linalg.norm(nearest - repeated, axis=1).reshape(len(points), len(triangles))


@given(st.integers(0, 10**6), st.integers(1, 300), st.floats(0.01, 100))
def test_equals_brute_force(seed: int, faces: int, spread: float) -> None:
    rng = np.random.default_rng(seed)
    vertices = rng.normal(size=(3 * faces, 3)) * (1, 1, 0.3) + (0, 0, 1000)
    vertices[2::9] = vertices[1::9][: len(vertices[2::9])]  # needles without area among them
    mesh = TriangleMesh(vertices, np.arange(3 * faces, dtype=np.int32).reshape(-1, 3))
    points = rng.normal(size=(50, 3)) * spread + (0, 0, 1000)
    flat = vertices[2::9]
    assert len(flat)
    expected = _brute_force(points, vertices[mesh.faces])
    np.testing.assert_allclose(deviation(points, mesh), expected.min(axis=1), rtol=1e-6, atol=1e-7)
