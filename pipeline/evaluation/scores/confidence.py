"""Confidence intervals of means over frames, by the bootstrap (Efron 1979)."""

from dataclasses import dataclass

import numpy as np

RESAMPLES = 2000
PERCENT = 95.0


@dataclass(frozen=True)
class MeanInterval:
    """Mean, the ends of its 95 % confidence interval (NaN for one value), and the number of values."""

    mean: float
    low: float
    high: float
    n: int


def mean_interval(values: np.ndarray, rng: np.random.Generator) -> MeanInterval:
    """The mean of ``(N,)`` values and its percentile bootstrap interval; NaN values are left out.

    Frames are drawn, not pixels: pixels of one frame share its pose and light. The interval is about the frames at
    hand; it does not know other surfaces.
    """
    kept = values[~np.isnan(values)]
    if len(kept) == 0:
        return MeanInterval(float("nan"), float("nan"), float("nan"), 0)
    mean = float(kept.mean())
    if len(kept) == 1 or not np.isfinite(kept).all():
        return MeanInterval(mean, float("nan"), float("nan"), len(kept))
    drawn = kept[rng.integers(len(kept), size=(RESAMPLES, len(kept)))].mean(axis=1)
    low, high = np.percentile(drawn, [(100 - PERCENT) / 2, (100 + PERCENT) / 2])
    return MeanInterval(mean, float(low), float(high), len(kept))
