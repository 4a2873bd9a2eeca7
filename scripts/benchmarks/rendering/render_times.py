"""Render times per view, ours and PyVista's, from alternating rounds; and their ratios.

Ratios are taken within a round, since a shared machine is slower at some times than at others.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

LIT_PEER = "PyVista, 8x MSAA, default light"
UNLIT_PEER = "PyVista, 8x MSAA, no light"
PLAIN_PEER = "PyVista, no MSAA, no light"
PEERS = (LIT_PEER, UNLIT_PEER, PLAIN_PEER)


@dataclass(frozen=True)
class TimeRatio:
    """Ratio of the median times, which is between the smallest and the largest ratio of any round."""

    median: float
    least: float
    most: float


@dataclass(frozen=True)
class RenderTimes:
    """Seconds per view by name, one entry per round; the names include :data:`PEERS`."""

    seconds: Mapping[str, tuple[float, ...]]

    @property
    def rounds(self) -> int:
        """Number of rounds."""
        return min(map(len, self.seconds.values()), default=0)

    @property
    def ours(self) -> tuple[str, ...]:
        """All names except :data:`PEERS`."""
        return tuple(name for name in self.seconds if name not in PEERS)

    def median_ms(self, name: str) -> float:
        """Median time of a view."""
        return float(np.median(self.seconds[name]) * 1e3)

    def ratio(self, name: str, peer: str) -> TimeRatio:
        """Time of ``name`` relative to ``peer``."""
        by_round = np.divide(self.seconds[name], self.seconds[peer])
        return TimeRatio(self.median_ms(name) / self.median_ms(peer), float(by_round.min()), float(by_round.max()))

    def table(self) -> list[str]:
        """Lines of a Markdown table: medians, and their ratios to PyVista's with and without its light."""
        lines = ["| view | ms | / PyVista 8x MSAA, default light | / no light |", "|---|---|---|---|"]
        for name in self.seconds:
            lit, unlit = (self.ratio(name, peer).median for peer in (LIT_PEER, UNLIT_PEER))
            lines.append(f"| {name} | {self.median_ms(name):.0f} | {lit:.2f} | {unlit:.2f} |")
        return lines

    def medians_ms(self) -> dict[str, float]:
        """Median times of a view in milliseconds, by name."""
        return {name: self.median_ms(name) for name in self.seconds}

    def rounds_ms(self) -> dict[str, list[float]]:
        """All times in milliseconds, by name."""
        return {name: [1e3 * value for value in each] for name, each in self.seconds.items()}

    @classmethod
    def of_ms(cls, rounds: Mapping[str, Sequence[float]]) -> "RenderTimes":
        """The times from what :meth:`rounds_ms` gave."""
        return cls({name: tuple(value / 1e3 for value in each) for name, each in rounds.items()})
