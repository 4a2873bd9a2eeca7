"""Noise of a frame: measured, removed where there is much of it, and else left with the texture."""

import numpy as np
import pytest

from oneframe.video.denoise import denoised, noise_of

SHOWN = np.ones((120, 160), bool)
SHOWN[:40] = False


def frame(noise: float) -> tuple[np.ndarray, np.ndarray]:
    """A striped slope, ``(120, 160, 3)``, and with noise, as uint8 codes."""
    row, column = np.mgrid[:120, :160]
    clean = np.repeat((90 + row / 2 + 60 * (column % 40 < 20))[..., None], 3, axis=2)
    noisy = clean + np.random.default_rng(0).normal(0, noise, clean.shape)
    # what is masked out does not count
    noisy[~SHOWN] = np.random.default_rng(1).uniform(0, 255, noisy[~SHOWN].shape)
    return clean, np.clip(np.rint(noisy), 0, 255).astype(np.uint8)


@pytest.mark.parametrize("noise", [3.0, 8.0, 15.0])
def test_much_noise_is_removed_and_little_stays(noise):
    clean, noisy = frame(noise)
    assert noise_of(noisy, SHOWN) == pytest.approx(noise, rel=0.1)
    found, said = denoised(noisy, SHOWN)
    if noise < 5:
        assert found is None
        assert "the colours stay" in said
    else:
        assert np.abs(found - clean)[SHOWN].mean() < 0.7 * np.abs(noisy - clean)[SHOWN].mean()
