"""Chart of the sweeps of the constraints on poses."""

from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any

from oneframe.charts.page import Theme, write_chart
from oneframe.poses.constraints import MAX_ATTEMPTS

from ..sweeps.cells import Cell
from .log_axes import log_axes, log_y
from .stability_panels import answer_legend, in_sweep, lines, small_print

CONSTRAINTS = (
    ("min_observed", "--min-observed", "least observed part of the surface"),
    ("min_surface", "--min-surface", "least surface, of the frame's"),
    ("min_clearance_mm", "--min-clearance-mm", "least clearance (mm)"),
)


def sampling_stability_charts(cells: Sequence[Cell], conditions: Sequence[str], data: Path) -> list[Path]:
    """Draw the chart; returns the files written."""
    draw = partial(_draw, cells=cells, conditions=conditions)
    return write_chart(data, draw, (12.6, 4.4), title="Sampling poses: tight constraints")


def _draw(figure: Any, theme: Theme, *, cells: Sequence[Cell], conditions: Sequence[str]) -> None:
    panels = figure.subplots(1, 4)
    for axes, (sweep, title, label) in zip(panels, CONSTRAINTS, strict=False):
        log_y(axes, 0.7, 2 * MAX_ATTEMPTS)
        # a refusal has tried all
        lines(axes, theme, in_sweep(cells, sweep), quantity=lambda cell: cell.value)
        axes.axhline(MAX_ATTEMPTS, color=theme.text, linewidth=1.2, linestyle=(0, (4, 2)))
        axes.text(
            0.02, MAX_ATTEMPTS * 0.85, "MAX_ATTEMPTS", transform=axes.get_yaxis_transform(), va="top", fontsize=7.5
        )
        axes.set_title(title)
        axes.set_xlabel(label, fontsize=9.5)
    panels[0].set_ylabel("poses tried for a view", fontsize=9.5)
    panels[0].legend(loc="center left", fontsize=9, frameon=False, labelcolor="linecolor")
    _draw_acceptance(panels[3], theme, cells)
    answer_legend(figure, theme)
    small_print(figure, theme, "A ridged bowl of 60 mm at 300 mm.", conditions)


def _draw_acceptance(axes: Any, theme: Theme, cells: Sequence[Cell]) -> None:
    """Chance that a long run fails, by the rate of acceptance, with the answers of the sampler."""
    rates = {cell.x: cell for cell in in_sweep(cells, "acceptance")}
    own = [cell for cell in in_sweep(cells, "long run") if cell.x > 0]
    log_axes(axes, [cell.x for cell in own])
    axes.plot([cell.x for cell in own], [cell.error for cell in own], color=theme.series[0], linewidth=1.3)
    for cell in own:
        answered = rates[cell.x].answer
        marker = {"works": "o", "warns": "^", "refuses": "x"}[answered]
        axes.scatter(cell.x, cell.error, color=theme.series[0], marker=marker, s=32, zorder=3)
    axes.set_ylim(-0.05, 1.2)
    axes.set_yticks([0, 0.5, 1], ["0", "50 %", "100 %"])
    for cell in own[:1]:
        axes.axvline(cell.limit, color=theme.text, linewidth=1.2, linestyle=(0, (4, 2)))
        axes.annotate(
            cell.constant, (cell.limit, 1), (3, -2), xycoords=("data", "axes fraction"), textcoords="offset points",
            va="top", fontsize=7.5,
        )  # fmt: skip
    axes.grid(axis="y", linewidth=0.8)
    axes.set_title("100 000 views: run ends early")
    axes.set_xlabel("part of the poses that is accepted", fontsize=9.5)
