"""The isosurface against closed forms and itself: closed, exact, and what a drill leaves keeps its vertices."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from oneframe.volume.bone.isosurface import Isosurface, RemovedField, isosurface
from oneframe.volume.volume import VoxelGrid
from tests.volume.solids import enclosed_mm3, is_closed, oblique_grid, scanned

SEEDS = st.integers(0, 2**32 - 1)


def index_grid(values: np.ndarray) -> VoxelGrid:
    """A grid in which index space is the frame of the mesh."""
    return VoxelGrid(values.shape[::-1], np.eye(4))


def noise(seed: int, *, largest: int = 9) -> np.ndarray:
    rng = np.random.default_rng(seed)
    return rng.normal(size=rng.integers(1, largest, 3))


def equal(a: Isosurface, b: Isosurface) -> bool:
    pairs = (a.mesh.vertices, b.mesh.vertices), (a.mesh.faces, b.mesh.faces), (a.drilled, b.drilled)
    return all(np.array_equal(*pair) for pair in pairs)


def sphere(points: np.ndarray) -> np.ndarray:
    return np.linalg.norm(points - (0.13, -0.21, 0.07), axis=1) - 9


def torus(points: np.ndarray) -> np.ndarray:
    x, y, z = (points - (0.13, -0.21, 0.07)).T
    return np.hypot(np.hypot(x, y) - 7, z) - 2.6


@given(SEEDS)
def test_drilled_surface_of_noise_is_closed_and_bone_keeps_its_vertices(seed):
    values, rng = noise(seed), np.random.default_rng(seed)
    solid = rng.random(values.shape) < 0.6 if seed % 2 else None
    lower = [int(rng.integers(0, n)) for n in values.shape]
    size = [int(rng.integers(1, n - at + 1)) for n, at in zip(values.shape, lower, strict=True)]
    removed = RemovedField(np.array(lower[::-1]), rng.normal(size=size).astype(np.float32))
    intact = isosurface(values, 0, index_grid(values), solid=solid)
    drilled = isosurface(values, 0, index_grid(values), solid=solid, removed=removed)
    assert is_closed(intact.mesh)
    assert is_closed(drilled.mesh)
    before = set(map(tuple, intact.mesh.vertices.tolist()))
    assert all(tuple(each) in before for each in drilled.mesh.vertices[~drilled.drilled].tolist())
    assert not intact.drilled.any()


@pytest.mark.parametrize("shape", [sphere, torus])
def test_surface_of_a_solid_is_within_a_hundredth_of_a_voxel_on_average(shape):
    for seed in range(2):
        rng = np.random.default_rng(seed)
        grid = oblique_grid(rng, rng.uniform(0.4, 0.6, 3), 60)
        mesh = isosurface(scanned(shape, grid), 300, grid).mesh
        error = np.abs(shape(mesh.vertices)) / grid.spacing_mm.min()
        assert error.mean() < 0.01
        assert enclosed_mm3(mesh) > 0
        assert is_closed(mesh)


def test_voxels_at_the_level_and_material_at_the_border_make_no_flat_faces():
    rng = np.random.default_rng(6)
    values = rng.integers(-1, 3, (12, 12, 12)).astype(np.int16)
    for data in (values, values.astype(np.float32)):
        mesh = isosurface(data, 1, index_grid(data)).mesh
        assert np.linalg.norm(mesh.face_cross, axis=1).min() > 1e-7
    full = isosurface(np.full((2, 3, 4), 9), 1, index_grid(np.empty((2, 3, 4)))).mesh
    np.testing.assert_array_equal(full.bounds, [[-0.5, -0.5, -0.5], [3.5, 2.5, 1.5]])


def test_solid_decides_what_counts_and_leaves_the_crossings_where_they_are():
    grid = oblique_grid(np.random.default_rng(7), np.array([0.5, 0.5, 0.5]), 50)
    apart = np.array([0.0, 0.0, 0.0, 6.0])

    def two(points: np.ndarray) -> np.ndarray:
        return np.minimum(sphere(points), np.linalg.norm(points - apart[:3] + (0, 0, 11.5), axis=1) - 1)

    both, one = scanned(two, grid), scanned(sphere, grid)
    assert (both != one).any()
    assert equal(isosurface(both, 300, grid, solid=one > 300), isosurface(one, 300, grid))
