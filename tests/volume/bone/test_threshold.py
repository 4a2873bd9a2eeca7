"""The threshold of bone: Otsu's against its definition."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from oneframe.errors import InputError
from oneframe.volume.bone.bone import HIGHEST_HU, LOWEST_HU, check_threshold, otsu_threshold
from oneframe.volume.volume import Volume, VoxelGrid


def volume(values: np.ndarray) -> Volume:
    return Volume(values.astype(np.int16), VoxelGrid(values.shape[::-1], np.eye(4)))


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
    ct = volume(np.rint(values))
    counted = ct.values[ct.values > -200].astype(float)

    def between(level: float) -> float:
        low, high = counted[counted < level], counted[counted >= level]
        return len(low) * len(high) * (low.mean() - high.mean()) ** 2 if len(low) and len(high) else 0.0

    best = max(between(level) for level in range(-199, 3500))
    threshold = otsu_threshold(ct)
    assert LOWEST_HU <= threshold <= HIGHEST_HU
    if LOWEST_HU < threshold < HIGHEST_HU:
        assert between(threshold) == pytest.approx(best)


def test_levels_without_voxels_on_both_sides_are_refused():
    ct = volume(np.arange(-500, 500).reshape(10, 10, 10))
    check_threshold(ct, 300)
    for level in (499, 3000, -600, float("nan")):
        with pytest.raises(InputError, match="between the volume's -500 and 499 HU"):
            check_threshold(ct, level)
    with pytest.raises(InputError, match="found no voxel above -200 HU"):
        otsu_threshold(volume(np.full((3, 3, 3), -1000)))
