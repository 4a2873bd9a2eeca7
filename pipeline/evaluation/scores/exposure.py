"""Exposure and colour gain between a photograph and a view, estimated robustly.

A camera's exposure and white balance multiply linear light by a factor for each channel. Code values follow nearly a
power law, so they are multiplied by a factor too.
"""

import numpy as np

DARKEST, BRIGHTEST = 10 / 255, 250 / 255
"""Code values beyond these are noise or saturated and say nothing about a factor."""
FEWEST_PIXELS = 50
MOST_PIXELS = 50_000
"""More make the estimate slower, not better: its error is that of shading and alignment."""
TUKEY = 4.685
"""Cut-off of Tukey's biweight in standard deviations: 95 % efficiency for normal errors (Huber, Robust Statistics)."""
MAD_TO_SIGMA = 1.4826
ROUNDS = 20


def colour_gain(real: np.ndarray, synthetic: np.ndarray, mask: np.ndarray) -> np.ndarray:
    """The factor ``(3,)`` by which the view's code values must be multiplied to match the photograph's.

    The centre of the logarithmic ratios by Tukey's biweight from their median: it tolerates highlights, occluders and
    unpainted surface on up to half of the pixels, and does not favour a blurred view as a least-squares fit would.

    Parameters
    ----------
    real, synthetic
        ``(H, W, 3)`` code values 0..1.
    mask
        ``(H, W)`` bool: the pixels to compare.

    Returns
    -------
    The factors; NaN if fewer than :data:`FEWEST_PIXELS` pixels are usable.
    """
    a, b = real[mask], synthetic[mask]
    step = max(len(a) // MOST_PIXELS, 1)
    return np.array([_gain(a[::step, channel], b[::step, channel]) for channel in range(3)])


def _gain(real: np.ndarray, synthetic: np.ndarray) -> float:
    usable = (real > DARKEST) & (real < BRIGHTEST) & (synthetic > DARKEST) & (synthetic < BRIGHTEST)
    if np.count_nonzero(usable) < FEWEST_PIXELS:
        return float("nan")
    ratios = np.log(real[usable].astype(float) / synthetic[usable])
    centre = float(np.median(ratios))
    # at least the width of a code value, else equal images leave no width at all
    width = max(MAD_TO_SIGMA * float(np.median(np.abs(ratios - centre))), 1 / 255)
    for _ in range(ROUNDS):
        weights = np.clip(1 - ((ratios - centre) / (TUKEY * width)) ** 2, 0, None) ** 2
        centre = float((weights * ratios).sum() / weights.sum())
    return float(np.exp(centre))


def corrected(synthetic: np.ndarray, gain: np.ndarray) -> np.ndarray:
    """``(H, W, 3)`` code values with the gain applied, clipped to 0..1; unchanged where the gain is NaN."""
    factors = np.where(np.isfinite(gain), gain, 1.0).astype(np.float32)
    return np.clip(synthetic * factors, 0, 1)
