"""Logarithmic axes with plain numbers."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np


def plain_log_axis(axis: Any, ticks: Sequence[float]) -> None:
    """Label a logarithmic axis with plain numbers at these ticks only."""
    from matplotlib.ticker import NullFormatter

    axis.set_ticks(ticks, [f"{tick:g}" for tick in ticks])
    axis.set_minor_formatter(NullFormatter())
    axis.minorticks_off()


def round_ticks(low: float, high: float) -> list[float]:
    """Round numbers from ``low`` to ``high`` for a logarithmic axis, at most nine."""
    from matplotlib.ticker import MaxNLocator

    powers = range(int(np.floor(np.log10(low))), int(np.ceil(np.log10(high))) + 1)
    for factors in (range(1, 10), (1, 2, 5), (1, 3), (1,)):
        values = [float(f"{factor}e{power}") for power in powers for factor in factors]
        ticks = [value for value in values if low <= value <= high]
        if len(ticks) <= 9:
            break
    if len(ticks) >= 3:
        return ticks
    # less than half a decade: nearly linear
    return [float(value) for value in MaxNLocator(5).tick_values(low, high) if low <= value <= high]


def log_axes(axes: Any, x: Sequence[float], y: tuple[float, float] | None = None) -> None:
    """Make the axes logarithmic: x over its positive values with plain numbers, y over a range if given."""
    axes.set_xscale("log")
    low, high = min(x), max(x)
    axes.set_xlim(low / (high / low) ** 0.05, high * (high / low) ** 0.05)
    ticks = one_two_five(low, high) if high / low < 60 else decade_ticks(low, high)
    plain_log_axis(axes.xaxis, ticks)
    axes.set_xticks(ticks, [short_number(tick) for tick in ticks])
    if y is not None:
        log_y(axes, *y)


def log_y(axes: Any, low: float, high: float) -> None:
    """Make the y axis logarithmic, with a number at each decade, or at every second of many."""
    axes.set_yscale("log")
    axes.set_ylim(low, high)
    ticks = decade_ticks(low, high)
    plain_log_axis(axes.yaxis, ticks)
    axes.set_yticks(ticks, [short_number(tick) for tick in ticks])


def one_two_five(low: float, high: float) -> list[float]:
    """1, 2 and 5 times powers of ten from ``low`` to ``high``."""
    powers = range(math.floor(math.log10(low)), math.ceil(math.log10(high)) + 1)
    values = [float(f"{factor}e{power}") for power in powers for factor in (1, 2, 5)]
    return [value for value in values if low <= value <= high]


def decade_ticks(low: float, high: float) -> list[float]:
    """Powers of ten from ``low`` to ``high``, at most five."""
    powers = range(math.ceil(math.log10(low) - 1e-9), math.floor(math.log10(high) + 1e-9) + 1)
    step = math.ceil(len(powers) / 5)
    return [float(f"1e{power}") for power in powers[::step]]


def short_number(value: float) -> str:
    """A number in few characters: 12 800 as 12.8k, 5 000 000 as 5M."""
    for factor, name in ((1e9, "G"), (1e6, "M"), (1e3, "k")):
        if abs(value) >= factor:
            return f"{value / factor:g}{name}"
    return f"{value:g}"
