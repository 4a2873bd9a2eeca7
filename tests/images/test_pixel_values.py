"""Values between pixels are bilinear inside the grid of centres, nothing outside; codes and light; averages."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from oneframe.images.contact_sheet import downscaled
from oneframe.images.pixel_values import among_centres, linear_from_codes, sample_bilinear, to_uint8
from oneframe.images.transfer import TRANSFERS
from tests.codes import codes_from_linear

SIZES = st.tuples(st.integers(1, 9), st.integers(1, 7))


@given(SIZES, st.tuples(st.floats(-3, 12), st.floats(-3, 12)))
def test_a_plane_is_sampled_exactly_inside_and_zero_outside(size, pixel):
    width, height = size
    v, u = np.mgrid[:height, :width].astype(float)
    (found,) = sample_bilinear(3 + 2 * u - 5 * v, np.array([pixel]))
    (inside,) = among_centres(np.array([pixel]), size)
    clipped = np.clip(pixel, 0, [width - 1, height - 1])
    assert inside == (np.abs(clipped - pixel).max() <= 1e-3)
    assert found == pytest.approx(3 + 2 * clipped[0] - 5 * clipped[1], abs=1e-9) if inside else found == 0


@pytest.mark.parametrize("curve", TRANSFERS.values(), ids=TRANSFERS)
def test_codes_and_light_go_both_ways(curve):
    codes = np.arange(256) / 255
    light = linear_from_codes(codes, curve)
    assert codes_from_linear(light, curve) == pytest.approx(codes, abs=1e-7)
    # the pieces meet, as far as the standards' digits go
    around = linear_from_codes(np.array([curve.straight, curve.straight + 1e-9]), curve)
    assert np.ptp(around) < 1e-4
    assert light[0] == 0
    assert light[-1] == pytest.approx(1)
    assert np.array_equal(to_uint8(codes), np.arange(256))


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
