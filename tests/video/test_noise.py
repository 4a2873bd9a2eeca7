"""Noise of a frame: measured, removed where there is much of it, and else left with the texture."""

import numpy as np
import pytest

from oneframe.video.frame_measures import denoised, noise_of


@pytest.mark.parametrize("noise", [3.0, 8.0, 15.0])
def test_much_noise_is_removed_and_little_stays(noise):
    row, column = np.mgrid[:120, :160]
    clean = np.repeat((90 + row / 2 + 60 * (column % 40 < 20))[..., None], 3, axis=2)
    shown, rng = row > 40, np.random.default_rng(0)
    noisy = np.where(shown[..., None], clean + rng.normal(0, noise, clean.shape), rng.uniform(0, 255, clean.shape))
    noisy = np.clip(np.rint(noisy), 0, 255).astype(np.uint8)
    assert noise_of(noisy, shown) == pytest.approx(noise, rel=0.1)
    found, _ = denoised(noisy, shown)
    assert (found is None) == (noise < 5)
    assert found is None or np.abs(found - clean)[shown].mean() < 0.7 * np.abs(noisy - clean)[shown].mean()
