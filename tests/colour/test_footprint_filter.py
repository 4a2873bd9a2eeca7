"""The averaged frames against scenes of which the frame's and the view's pixels are true means."""

import cv2
import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from oneframe.colour.footprint_filter import averaged, squares_for
from oneframe.images.pixel_values import sample_bilinear

SIZE, FINE = 64, 20


@pytest.fixture(scope="module")
def scene() -> np.ndarray:
    """``(SIZE FINE, SIZE FINE)`` code values with detail down to a third of a frame pixel."""
    noise = np.random.default_rng(5).normal(size=(SIZE * FINE, SIZE * FINE)).astype(np.float32)
    layers = ((0.35, 0.3), (0.7, 0.5), (2, 1), (8, 1.5))
    total = sum(w * each / each.std() for s, w in layers for each in [cv2.GaussianBlur(noise, (0, 0), s * FINE)])
    return 127 + 38 * total / total.std()


@pytest.fixture(scope="module")
def sums(scene) -> np.ndarray:
    """Of all that is above and left of each corner of the scene's pixels."""
    return np.pad(scene.astype(np.float64).cumsum(0).cumsum(1), ((1, 0), (1, 0)))


def means_over_squares(sums: np.ndarray, centres: np.ndarray, side: float) -> np.ndarray:
    """The means of a scene over squares, all in frame pixels, and in whole steps of 1 / FINE."""
    low, high = (np.rint((centres + sign * side / 2 + 0.5) * FINE).astype(int) for sign in (-1, 1))
    (left, top), (right, bottom) = low.T, high.T
    total = sums[bottom, right] - sums[top, right] - sums[bottom, left] + sums[top, left]
    return total / (high - low).prod(axis=1)


def frame_of(scene: np.ndarray) -> np.ndarray:
    return scene.reshape(SIZE, FINE, SIZE, FINE).mean(axis=(1, 3))


def filtered_lookups(frame: np.ndarray, centres: np.ndarray, scale: float) -> np.ndarray:
    """The mean of four lookups, as of the surface's material."""
    side, offset = squares_for(scale)
    image, place = averaged(frame[..., None], np.ones(frame.shape, dtype=bool), side)
    steps = [(right * offset - place, down * offset - place) for right in (-1, 1) for down in (-1, 1)]
    return np.mean([sample_bilinear(image[..., 0], centres + step) for step in steps], axis=0)


def means_of_interpolant(frame: np.ndarray, centres: np.ndarray, scale: float) -> np.ndarray:
    """What counts the frame's pixels twice: the mean of its bilinear interpolant over the footprint."""
    steps = ((np.arange(16) + 0.5) / 16 - 0.5) * scale
    points = centres[:, None] + np.stack(np.meshgrid(steps, steps), -1).reshape(-1, 2)
    return sample_bilinear(frame, points.reshape(-1, 2)).reshape(len(centres), -1).mean(axis=1)


def rms(difference: np.ndarray) -> float:
    return float(np.sqrt(np.mean(difference**2)))


@pytest.mark.parametrize("scale", [1.0, 1.1, 2.0, 3.0, 4.5, 11.0])
def test_near_to_the_scene(rng, scene, sums, scale):
    frame, centres = frame_of(scene), np.rint(rng.uniform(16, SIZE - 17, (600, 2)) * FINE) / FINE
    truth = means_over_squares(sums, centres, scale)
    error = rms(filtered_lookups(frame, centres, scale) - truth)
    if scale <= 3:
        assert error < 0.9 * rms(means_of_interpolant(frame, centres, scale) - truth)
    else:
        assert error < 0.025 * scene.std()
    if scale >= 2:
        assert error < 0.8 * rms(sample_bilinear(frame, centres) - truth)


@pytest.mark.parametrize("scale", [0.2, 1.0])
def test_at_the_frame_s_own_scale_and_nearer_nothing_is_filtered(rng, scene, scale):
    frame, centres = frame_of(scene), rng.uniform(4, SIZE - 5, (200, 2))
    assert np.allclose(filtered_lookups(frame, centres, scale), sample_bilinear(frame, centres), rtol=1e-5)


@pytest.mark.parametrize("period", [2, 4, 8])
def test_stripes_average_to_their_mean_and_never_alias(rng, period):
    stripes = np.where(np.arange(SIZE) % period < period / 2, 255.0, 0.0)
    frame, centres = np.tile(stripes, (SIZE, 1)), rng.uniform(20, SIZE - 21, (400, 2))
    assert np.abs(filtered_lookups(frame, centres, float(period)) - 127.5).max() < 0.01
    for scale in np.linspace(period, 2.5 * period, 12):
        # a box's own response to them is at most a quarter of their contrast, from the second lobe of its spectrum
        assert np.abs(filtered_lookups(frame, centres, scale) - 127.5).max() < 127.5 * 0.3


def test_colours_of_unknown_texels_are_never_used(rng):
    image = rng.uniform(size=(SIZE, SIZE, 3)).astype(np.float32)
    known = gaussian_filter(rng.normal(size=(SIZE, SIZE)), 4) > 0
    known[:8, :8] = False
    other = np.where(known[..., None], image, 7.0)
    for side in (1, 2):
        assert np.array_equal(averaged(image, known, side)[0], averaged(other, known, side)[0])
    assert np.array_equal(averaged(image, known, 1)[0][known], image[known])
