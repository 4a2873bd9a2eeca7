"""Connected parts against SciPy, and which voxels of a CT count as bone; Otsu's threshold against its definition."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.ndimage import label

from oneframe.errors import InputError
from oneframe.volume.bone.bone import (
    HIGHEST_HU,
    LOWEST_HU,
    bone_voxels,
    check_threshold,
    otsu_threshold,
    without_crumbs,
)
from oneframe.volume.bone.isosurface import RemovedField
from oneframe.volume.simple_itk import components
from oneframe.volume.volume import Volume, VoxelGrid


def ct(values: np.ndarray, spacing: float = 1.0) -> Volume:
    return Volume(values.astype(np.int16), VoxelGrid(values.shape[::-1], np.diag([spacing, spacing, spacing, 1.0])))


@given(st.integers(0, 2**32 - 1), st.floats(0, 1))
def test_parts_are_those_of_scipy(seed, share):
    rng = np.random.default_rng(seed)
    mask = rng.random(rng.integers(1, 40, 3)) < share
    found, (expected, count) = components(mask), label(mask)
    assert len(found.voxels) == count
    assert found.voxels.sum() == mask.sum()
    border = np.ones(mask.shape, bool)
    border[1:-1, 1:-1, 1:-1] = False
    for part in range(min(count, 5)):
        painted = found.chosen(np.arange(count) == part)
        # exactly one of theirs
        (number,) = np.unique(expected[painted])
        assert np.array_equal(painted, expected == number)
        assert found.voxels[part] == painted.sum()
        assert found.touching_border[part] == (painted & border).any()


def test_bone_is_the_largest_part_with_tiny_holes_filled_and_cells_open():
    values = np.full((20, 20, 40), -1000)
    values[4:16, 4:16, 4:16] = 700  # bone
    values[6:9, 6:9, 6:9] = -1000  # a cell of 27 mm³
    values[12, 12, 12] = -1000  # a hole of 1 mm³
    values[2:18, 2:18, 30] = 700  # a plate of 256 mm³
    values[0, 0, 0] = 700
    expected = np.zeros(values.shape, bool)
    expected[4:16, 4:16, 4:16] = True
    expected[6:9, 6:9, 6:9] = False
    assert np.array_equal(bone_voxels(ct(values), 300, hole_mm3=2), expected)
    expected[12, 12, 12] = False
    assert np.array_equal(bone_voxels(ct(values), 300, hole_mm3=0), expected)
    expected[2:18, 2:18, 30] = True
    assert np.array_equal(bone_voxels(ct(values), 300, hole_mm3=0, smallest_mm3=200), expected)
    # volumes are in mm³, not in voxels
    assert not bone_voxels(ct(values, 0.5), 300, hole_mm3=0, smallest_mm3=200)[3, 3, 30]


def test_empty_threshold_and_too_large_islands_are_explained():
    values = np.full((4, 4, 4), -1000)
    values[1, 1, 1] = 400
    with pytest.raises(InputError, match="found none; the volume holds -1000 to 400 HU"):
        bone_voxels(ct(values), 400)
    with pytest.raises(InputError, match="the largest has 1 mm³"):
        bone_voxels(ct(values), 300, smallest_mm3=2)


def test_crumbs_that_the_drill_cuts_off_are_washed_away():
    solid = np.ones((10, 10, 30), bool)
    distance = np.ones((10, 10, 10), np.float32)
    distance[:, :, 5] = -1
    removed = RemovedField(np.array([20, 0, 0]), distance)
    grid = ct(solid).grid
    assert without_crumbs(solid, grid, removed, smallest_mm3=400).all()
    left = without_crumbs(solid, grid, removed, smallest_mm3=401)
    # the drilled layer counts as bone: the drill's own distance makes its surface
    assert left[:, :, :26].all()
    assert not left[:, :, 26:].any()


@settings(max_examples=10)
@given(
    seed=st.integers(0, 999), tissue=st.integers(-100, 150), bone=st.integers(300, 2500), share=st.floats(0.05, 0.95)
)
def test_no_other_threshold_separates_better(seed, tissue, bone, share):
    rng = np.random.default_rng(seed)
    values = np.where(
        rng.random((6, 8, 9)) < share, rng.normal(tissue, 40, (6, 8, 9)), rng.normal(bone, 150, (6, 8, 9))
    )
    values[0] = -1000
    scan = ct(np.rint(values))
    counted = scan.values[scan.values > -200].astype(float)

    def between(level: float) -> float:
        low, high = counted[counted < level], counted[counted >= level]
        return len(low) * len(high) * (low.mean() - high.mean()) ** 2 if len(low) and len(high) else 0.0

    best = max(between(level) for level in range(-199, 3500))
    threshold = otsu_threshold(scan)
    assert LOWEST_HU <= threshold <= HIGHEST_HU
    if LOWEST_HU < threshold < HIGHEST_HU:
        assert between(threshold) == pytest.approx(best)


def test_levels_without_voxels_on_both_sides_are_refused():
    scan = ct(np.arange(-500, 500).reshape(10, 10, 10))
    check_threshold(scan, 300)
    for level in (499, 3000, -600, float("nan")):
        with pytest.raises(InputError, match="between the volume's -500 and 499 HU"):
            check_threshold(scan, level)
    with pytest.raises(InputError, match="found no voxel above -200 HU"):
        otsu_threshold(ct(np.full((3, 3, 3), -1000)))
