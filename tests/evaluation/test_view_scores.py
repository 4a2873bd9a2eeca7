"""Scores of a view against a photograph: what equal, shifted, brighter and blurred images must give."""

import cv2
import numpy as np
import pytest

from oneframe.evaluation.view_scores import (
    SCORES,
    colour_gain,
    corrected,
    scores_of,
    similarity,
    whole_and_parts,
)

HEIGHT, WIDTH = 180, 240


@pytest.fixture
def photograph(rng):
    """Detail of all sizes down to two pixels, and a little noise, in 0.1 .. 0.9."""
    image = np.zeros((HEIGHT, WIDTH, 3))
    for sigma in (1.0, 2.5, 6.0, 15.0):
        octave = cv2.GaussianBlur(rng.normal(size=image.shape), (0, 0), sigma)
        image += octave / octave.std()
    return np.clip(0.5 + 0.1 * image + rng.normal(0, 0.01, image.shape), 0.1, 0.9).astype(np.float32)


@pytest.fixture
def masks():
    """Surface, and its observed part."""
    v, u = np.mgrid[:HEIGHT, :WIDTH]
    surface = (u - 120) ** 2 / 100**2 + (v - 90) ** 2 / 75**2 < 1
    return surface, surface & (u < 150)


def shifted(image: np.ndarray, x: float, y: float) -> np.ndarray:
    matrix = np.array([[1, 0, x], [0, 1, y]], float)
    return cv2.warpAffine(image, matrix, (WIDTH, HEIGHT), flags=cv2.INTER_LANCZOS4, borderMode=cv2.BORDER_REFLECT)


def test_equal_images_are_perfect(photograph, masks):
    values = scores_of(photograph, photograph.copy(), *masks)
    assert set(values) == set(SCORES)
    for score, value in values.items():
        if score.startswith(("ssim", "gain")):
            assert value == pytest.approx(1, abs=1e-5), score
        elif score.startswith("error"):
            assert value == pytest.approx(0, abs=1e-3), score
        elif score.startswith("psnr") and "corrected" not in score:
            assert value == np.inf


def test_the_whole_image_is_that_of_a_plain_library(photograph, masks, rng):
    """The crop to the surface changes nothing: outside both images are black."""
    from skimage.metrics import peak_signal_noise_ratio, structural_similarity

    surface, _ = masks
    view = np.clip(photograph + rng.normal(0, 0.1, photograph.shape), 0, 1).astype(np.float32)
    black = [np.where(surface[..., None], image, np.float32(0)) for image in (photograph, view)]
    _, full = structural_similarity(*black, win_size=7, channel_axis=2, data_range=1.0, full=True)
    (ssim, psnr), _ = whole_and_parts(photograph, view, [surface], surface.size)
    assert ssim == pytest.approx(float(full.mean()), abs=1e-6)
    assert psnr == pytest.approx(peak_signal_noise_ratio(*black, data_range=1.0), abs=1e-4)
    # more background, more similar: why the paper's protocol flatters
    assert ssim > similarity(photograph, view, surface).ssim + 0.1


def test_a_gain_is_found_among_outliers(photograph, masks, rng):
    surface, _ = masks
    gain = np.array([1.2, 0.9, 1.05])
    view = np.clip(photograph / gain, 0, 1).astype(np.float32)
    # three tenths are highlights, all to one side
    outliers = rng.random(surface.shape) < 0.3
    view[outliers] = 0.95
    assert colour_gain(photograph, view, surface) == pytest.approx(gain, abs=2e-3)
    # also where the images are displaced: a least-squares factor would be too low
    assert colour_gain(photograph, shifted(photograph / np.float32(1.1), 4, 3), surface) == pytest.approx(1.1, abs=0.03)
    assert np.isnan(colour_gain(photograph, np.zeros_like(photograph), surface)).all()
    assert corrected(view, np.full(3, np.nan)) == pytest.approx(view)


def test_what_is_missing_has_no_scores(photograph, masks):
    surface, _ = masks
    nothing = np.zeros_like(surface)
    values = scores_of(photograph, photograph, nothing, nothing)
    assert {score for score, value in values.items() if not np.isnan(value)} == {"surface_px", "observed_px"}
    values = scores_of(photograph, photograph, surface, nothing)
    assert values["ssim_surface"] == pytest.approx(1)
    assert np.isnan(values["ssim_observed"])
