"""Chart of many workers: efficiency against their number, and what an order costs scheduler and client."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from ..scaling.cluster_model import Policy
from ..scaling.efficiency import ALIKE, ModelPoint
from .page import OURS, PEER, WARNING, Theme, note, plain_log_axis, write_chart

LOOKS = {
    Policy.CHUNKS.value: (OURS, "o", "-"),
    ALIKE: (OURS, "", ":"),
    Policy.SINGLE.value: (PEER, "s", "-"),
    Policy.SHARDS.value: (WARNING, "^", "-"),
}
"""Series, marker and line of each series of the model."""


def scaling_charts(
    points: Sequence[ModelPoint], costs: Sequence[tuple[int, float, float]], conditions: str, data: Path
) -> list[Path]:
    """Draw the chart; returns the files written.

    Parameters
    ----------
    points
        The model's.
    costs
        Measured: number of workers, ms of the client and ms of the scheduler for an order.
    conditions
        One line of small print.
    data
        The file with the figures.
    """
    least = min(point.target_seconds for point in points)
    points = [point for point in points if point.target_seconds == least]
    times = list(dict.fromkeys(point.seconds_per_view for point in points))
    ticks = [10**power for power in range(5) if 10**power <= max(point.workers for point in points)]

    def draw(figure: Any, theme: Theme) -> None:
        panels = figure.subplots(1, len(times) + bool(costs), squeeze=False)[0]
        for axes, seconds in zip(panels, times, strict=False):
            for name, (series, marker, line) in LOOKS.items():
                row = [point for point in points if (point.series, point.seconds_per_view) == (name, seconds)]
                axes.plot(
                    [point.workers for point in row],
                    [100 * point.efficiency for point in row],
                    color=theme.series[series],
                    marker=marker,
                    markersize=5,
                    linestyle=line,
                    label=name,
                )
            axes.set(title=f"{seconds:g} s a view", ylim=(0, 103), xscale="log", xlabel="workers")
            axes.grid(linewidth=0.8)
            plain_log_axis(axes.xaxis, ticks)
        panels[0].set_ylabel("efficiency (%)")
        handles, labels = panels[0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside upper right", ncols=len(labels), frameon=False, fontsize=9.5)
        if costs:
            _costs(panels[-1], theme, costs)
        note(
            figure,
            theme,
            "Modelled with the measured cost of an order: start 10 s, 5 % of the workers 10 times slower, "
            f"failures (24 h), preemption (6 h). {conditions}",
        )

    return write_chart(data, draw, (13.2, 4.4), title="100 000 views on many workers")


def _costs(axes: Any, theme: Theme, costs: Sequence[tuple[int, float, float]]) -> None:
    workers, client, scheduler = zip(*costs, strict=True)
    axes.plot(workers, scheduler, color=theme.series[OURS], marker="o", markersize=5, label="scheduler")
    axes.plot(workers, client, color=theme.series[PEER], marker="s", markersize=5, label="client")
    axes.set(title="measured: processor time of an order", xscale="log", yscale="log")
    axes.set(xlabel="simulated workers", ylabel="ms")
    low, high = min(*client, *scheduler), max(*client, *scheduler)
    axes.set_ylim(low / 1.5, high * 1.5)
    axes.grid(linewidth=0.8)
    plain_log_axis(axes.xaxis, [10**power for power in range(5) if 10**power <= max(workers)])
    plain_log_axis(
        axes.yaxis, [value for value in (0.5, 1, 2, 5, 10, 20, 50, 100, 200, 500) if low / 1.5 <= value <= high * 1.5]
    )
    axes.legend(loc="upper right", frameon=False, fontsize=9.5)
