"""What a label map shows as removed, taken out of the bone."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from oneframe.volume.bone.isosurface import RemovedField, isosurface
from oneframe.volume.make_surface import removed_by_labels, united
from oneframe.volume.volume import LabelMap, Volume, VoxelGrid
from tests.volume.solids import oblique_grid, voxel_centres, whole

BURR, RADIUS = np.array([8.0, 2.0, 3.0]), 5.0


def distances(grid: VoxelGrid, centre: np.ndarray) -> np.ndarray:
    """``(Z, Y, X)`` from the voxels to a point, mm."""
    return np.linalg.norm(voxel_centres(grid) - centre, axis=-1)


def scan(grid: VoxelGrid) -> Volume:
    """A ball of bone of 9 mm."""
    values = 300 + np.clip((9 - distances(grid, np.zeros(3))) * 1200, -1300, 900)
    return Volume(values.astype(np.int16), grid)


def check_cavity(before: Volume, removed: RemovedField, error_mm: float) -> None:
    """The surface without the removed part is that of ball and burr, and the ball's is as it was."""
    solid = before.values > 300
    intact = isosurface(before.values, 300, before.grid, solid=solid).mesh.vertices
    surface = isosurface(before.values, 300, before.grid, solid=solid, removed=removed)
    made = surface.mesh.vertices[surface.drilled]
    assert len(made) > 100
    assert np.abs(np.linalg.norm(made - BURR, axis=1) - RADIUS).mean() < error_mm
    kept = surface.mesh.vertices[~surface.drilled]
    assert set(map(tuple, kept.tolist())) < set(map(tuple, intact.tolist()))
    assert (np.linalg.norm(kept - BURR, axis=1) > RADIUS - before.grid.spacing_mm[0]).all()


@pytest.mark.parametrize(("size", "spacing", "seed"), [(60, 0.4, 1), (30, 0.9, 2)])
def test_labels_on_any_grid_are_removed(size, spacing, seed):
    before = scan(oblique_grid(np.random.default_rng(1), 0.4, 60))
    grid = oblique_grid(np.random.default_rng(seed), spacing, size)
    labels = LabelMap((distances(grid, BURR) < RADIUS).astype(np.uint8), grid, {1: "removed"})
    check_cavity(before, removed_by_labels(labels, before.grid), 0.25 * spacing)


@given(st.integers(0, 2**32 - 1))
def test_united_field_removes_what_any_removes(seed):
    rng = np.random.default_rng(seed)
    fields = [
        RemovedField(rng.integers(0, 6, 3), rng.normal(size=rng.integers(1, 6, 3)).astype(np.float32)) for _ in range(3)
    ]

    grid = VoxelGrid((12, 12, 12), np.eye(4))
    assert np.array_equal(whole(united(fields), grid), np.min([whole(field, grid) for field in fields], axis=0))
    assert united([]) is None
