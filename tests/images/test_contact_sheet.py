"""Reduction by averaging over areas."""

import numpy as np
import pytest

from oneframe.images.contact_sheet import downscaled


@pytest.mark.parametrize("width", [1, 35])
def test_reduced_pixels_are_the_means_of_their_areas(rng, width):
    image = rng.random((84, 36, 3), dtype=np.float32)
    small = downscaled(image, width)
    # every pixel repeated until both grids have common edges
    height = small.shape[0]
    fine = np.repeat(np.repeat(image.astype(float), height, axis=0), width, axis=1)
    means = fine.reshape(height, 84, width, 36, 3).mean(axis=(1, 3))
    assert small.shape == (round(84 * width / 36), width, 3)
    assert small == pytest.approx(means, abs=1e-6)
