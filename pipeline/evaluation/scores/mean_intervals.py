"""Means of photographs with 95 % confidence intervals, clustered: by surface, by case, by photograph. Needs ``scipy``.

Photographs of one surface, coloured from one frame, resemble each other: 300 of them say little about the next surface.
So whole surfaces are drawn first, then cases (source frames) of each, then photographs (the nested bootstrap; Davison
and Hinkley 1997, 3.8), and each of them counts as much as its neighbours. Pixels are never drawn.
"""

from collections.abc import Hashable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import ndtr, stdtrit

RESAMPLES = 2000
LEVEL = 0.95


@dataclass(frozen=True)
class MeanInterval:
    """Mean, the ends of its confidence interval (NaN for one value), and the number of values."""

    mean: float
    low: float
    high: float
    n: int


class Resampling:
    """Draws the same photographs for all values, so that differences are paired.

    Parameters
    ----------
    paths
        Of each photograph: what it belongs to, from the outermost, and itself, such as (surface, case, photograph).
    rng
        Draws.
    """

    def __init__(self, paths: Sequence[tuple[Hashable, ...]], rng: np.random.Generator) -> None:
        self._weights = np.zeros((RESAMPLES + 1, len(paths)))

        def draw(members: Sequence[int], times: np.ndarray, share: float, depth: int) -> None:
            if depth == len(paths[members[0]]):
                self._weights[:, members] = (share * times)[:, None]
                return
            parts: dict[Hashable, list[int]] = {}
            for member in members:
                parts.setdefault(paths[member][depth], []).append(member)
            # a group that was drawn m times is drawn from m times, independently
            counts = rng.multinomial(times * len(parts), np.full(len(parts), 1 / len(parts)))
            counts[0] = 1
            for part, count in zip(parts.values(), counts.T, strict=True):
                draw(part, count, share / len(parts), depth + 1)

        draw(range(len(paths)), np.ones(RESAMPLES + 1, int), 1.0, 0)
        outermost = next((level for level in zip(*paths, strict=True) if len(set(level)) > 1), paths)
        self._units = np.unique([str(unit) for unit in outermost], return_inverse=True)[1]

    def interval(self, values: np.ndarray) -> MeanInterval:
        """The mean of ``(N,)`` values, and its expanded percentile interval; NaN values are left out.

        A percentile interval of few units is too narrow; its percentiles are those that would make that of normal means
        Student's (Hesterberg 2015, "What teachers should know about the bootstrap", 3.3).
        """
        known = ~np.isnan(values)
        nan, units = float("nan"), len(np.unique(self._units[known]))
        if units == 0:
            return MeanInterval(nan, nan, nan, 0)
        weights = self._weights[:, known]
        # what is left out gives its weight to the others
        shares = weights.sum(axis=1)
        mean = float(weights[0] @ values[known] / shares[0])
        if units == 1 or not np.isfinite(mean):
            return MeanInterval(mean, nan, nan, int(known.sum()))
        drawn = weights[shares > 0] @ values[known] / shares[shares > 0]
        tail = ndtr(np.sqrt(units / (units - 1)) * stdtrit(units - 1, (1 - LEVEL) / 2))
        low, high = np.quantile(drawn, [tail, 1 - tail])
        return MeanInterval(mean, float(low), float(high), int(known.sum()))
