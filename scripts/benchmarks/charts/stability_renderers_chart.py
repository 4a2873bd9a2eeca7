"""Chart of the sweeps of the renderers."""

from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any

from oneframe.charts.page import Theme, write_chart

from ..sweeps.cells import Cell
from .log_axes import log_axes, short_number
from .stability_panels import answer_legend, distinct, in_sweep, lines, small_print

SCALING = (
    ("first view", "Time to the first view", "s", (0.1, 300)),
    ("time", "Time of a view", "s", (0.002, 20)),
    ("memory", "Memory", "MB at the peak", (100, 30_000)),
)


def renderer_stability_charts(cells: Sequence[Cell], conditions: Sequence[str], data: Path) -> list[Path]:
    """Draw the chart; returns the files written."""
    draw = partial(_draw, cells=cells, conditions=conditions)
    return write_chart(data, draw, (12.6, 7.4), title="Renderers: aliasing, rasterisers, and the size of the surface")


def _draw(figure: Any, theme: Theme, *, cells: Sequence[Cell], conditions: Sequence[str]) -> None:
    panels = figure.subplots(2, 3).ravel()
    for axes, series, title in zip(
        panels, ("rays at edges", "every pixel"), ("Aliasing of a dataset's views", "The same samples in every pixel"),
        strict=False,
    ):  # fmt: skip
        _draw_samples(axes, theme, in_sweep(cells, "samples", series))
        axes.set_title(title)
    _draw_rasterisers(panels[2], theme, cells)
    for axes, (sweep, title, label, limits) in zip(panels[3:], SCALING, strict=True):
        own = in_sweep(cells, sweep)
        log_axes(axes, [cell.x for cell in own], limits)
        lines(axes, theme, own, quantity=lambda cell: cell.value)
        axes.set_title(title)
        axes.set_xlabel("triangles", fontsize=9.5)
        axes.set_ylabel(label, fontsize=9.5)
    panels[3].legend(loc="upper left", fontsize=9, frameon=False, labelcolor="linecolor")
    answer_legend(figure, theme)
    small_print(
        figure,
        theme,
        "A ridged bowl that fills the frame, views of 320x240 px; time with all cores, memory of the whole process.",
        conditions,
    )


def _draw_samples(axes: Any, theme: Theme, cells: Sequence[Cell]) -> None:
    """Mean colour error by number of samples, a line for each reduction of the frame."""
    log_axes(axes, [cell.x for cell in cells], (0.01, 300))
    for reduction, style in zip(distinct([cell.y for cell in cells]), ("-", "--", "-.", ":"), strict=False):
        own = [cell for cell in cells if cell.y == reduction]
        axes.plot(
            [cell.x for cell in own], [cell.error for cell in own], color=theme.series[0], linestyle=style,
            linewidth=1.3, label=f"frame reduced {reduction:g} times",
        )  # fmt: skip
        for cell in own:
            marker = "^" if cell.answer == "warns" else "o"
            axes.scatter(cell.x, cell.error, color=theme.series[1 if cell.wrong else 0], marker=marker, s=26, zorder=3)
    axes.axhline(4.0, color=theme.series[1], linewidth=1, linestyle=(0, (1, 2)))
    values = distinct([cell.x for cell in cells])
    axes.set_xticks(values, [short_number(value) for value in values])
    axes.set_xlabel("samples", fontsize=9.5)
    axes.set_ylabel("mean colour error (of 255)", fontsize=9.5)
    axes.grid(axis="y", linewidth=0.8)
    axes.legend(loc="upper right", fontsize=8.5, frameon=False)


def _draw_rasterisers(axes: Any, theme: Theme, cells: Sequence[Cell]) -> None:
    """Pixels whose silhouette, and whose observed flag, differ from Cycles' by tilt."""
    from matplotlib.ticker import MaxNLocator

    engines = distinct([cell.series for cell in in_sweep(cells, "silhouette against Cycles")])
    for number, engine in enumerate(engines):
        # equal lines must not hide each other
        width = 1.5 + 2.5 * (len(engines) - 1 - number)
        own = in_sweep(cells, "silhouette against Cycles", engine)
        x = [cell.x for cell in own]
        axes.plot(
            x, [cell.error for cell in own], color=theme.series[number], marker="o", markersize=4 + width,
            linewidth=width, label=f"{engine}: silhouette",
        )  # fmt: skip
        axes.plot(
            x, [cell.value for cell in own], color=theme.series[number], marker="s", linestyle="--",
            markerfacecolor=theme.background, label=f"{engine}: what the frame saw",
        )  # fmt: skip
    axes.set_ylim(0, 12)
    axes.yaxis.set_major_locator(MaxNLocator(integer=True))
    axes.grid(axis="y", linewidth=0.8)
    axes.set_title("Rasterisers against Cycles")
    axes.set_xlabel("tilt of the view (°)", fontsize=9.5)
    axes.set_ylabel("differing pixels of 76 800", fontsize=9.5)
    axes.legend(loc="upper right", fontsize=8.5, frameon=False)
