"""The filtered image against means computed by brute force, and what it must leave alone."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.ndimage import gaussian_filter, map_coordinates

from pipeline.colour.footprint_filter import footprint_kernel, mean_over_pixels, prefiltered
from pipeline.images.pixel_values import sample_bilinear

SIZE = 64


def photograph_like(rng: np.random.Generator) -> np.ndarray:
    noise = rng.normal(size=(SIZE, SIZE))
    image = sum(weight * gaussian_filter(noise, sigma) for sigma, weight in ((0.7, 0.3), (2, 1), (8, 8)))
    return (0.5 + 0.2 * image / image.std()).astype(np.float32)


def brute_force_means(image: np.ndarray, centres: np.ndarray, footprint: float, angle: float) -> np.ndarray:
    steps = (np.arange(24) + 0.5) / 24 - 0.5
    offsets = np.stack(np.meshgrid(steps, steps), -1).reshape(-1, 2) * footprint
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    points = centres[:, None] + offsets @ turn.T
    return sample_bilinear(image, points.reshape(-1, 2)).reshape(len(centres), -1).mean(axis=1)


@pytest.mark.parametrize("footprint", [0.8, 1.0, 1.5, 3.0, 6.5])
@pytest.mark.parametrize("angle", [0.0, 0.4])
def test_one_spline_lookup_is_the_mean_over_the_footprint(rng, footprint, angle):
    image = photograph_like(rng)
    centres = rng.uniform(12, SIZE - 13, (400, 2))
    wanted = brute_force_means(image, centres, footprint, angle)
    filtered = prefiltered(image[..., None], np.ones(image.shape, dtype=bool), footprint)[..., 0]
    got = map_coordinates(filtered, centres[:, ::-1].T, order=3, prefilter=False)
    point_samples = sample_bilinear(image, centres)
    error, unfiltered = (np.sqrt(np.mean((colours - wanted) ** 2)) * 255 for colours in (got, point_samples))
    assert error < max(0.4, 0.1 * unfiltered)
    assert error < 0.5 * unfiltered


@given(footprint=st.floats(0.05, 40.0))
def test_kernels_keep_brightness_and_slopes(footprint):
    kernel = footprint_kernel(footprint)
    assert kernel.sum() == pytest.approx(1, abs=1e-9)
    assert np.array_equal(kernel, kernel[::-1])
    # hardly any overshoot: |k| sums to the largest contrast that can come out
    assert np.abs(kernel).sum() < 2.1


def test_colours_of_unknown_texels_are_never_used(rng):
    image = rng.uniform(size=(SIZE, SIZE, 3)).astype(np.float32)
    known = gaussian_filter(rng.normal(size=(SIZE, SIZE)), 4) > 0
    known[:8, :8] = False
    other = np.where(known[..., None], image, 7.0)
    assert np.array_equal(prefiltered(image, known, 1.5), prefiltered(other, known, 1.5))


def test_the_known_region_is_continued_evenly(rng):
    known = gaussian_filter(rng.normal(size=(SIZE, SIZE)), 4) > 0
    image = np.where(known, 0.25, 9.0)[..., None].astype(np.float32)
    filtered = prefiltered(image, known, 3.0)
    assert np.allclose(filtered[known], 0.25, atol=1e-6)


def test_nothing_known_is_no_error():
    assert not prefiltered(np.ones((9, 7, 3), np.float32), np.zeros((9, 7), dtype=bool), 1.0).any()


def test_pixel_means_are_exact_for_quadratics(rng):
    a, b, c, d, e, f = rng.normal(size=6)
    v, u = np.mgrid[:12, :17].astype(float)
    centres = a * u**2 + b * u * v + c * v**2 + d * u + e * v + f
    means = mean_over_pixels(centres[..., None])[..., 0]
    # the mean of t^2 over -1/2..1/2 is 1/12
    assert np.allclose(means[1:-1, 1:-1], (centres + (a + c) / 12)[1:-1, 1:-1])
