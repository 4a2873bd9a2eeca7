"""Chart of the sweeps of the refinement: its basin of convergence, and bad frames."""

from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any

from oneframe.charts.page import Theme, write_chart

from ..sweeps.cells import Cell
from .stability_panels import (
    distinct,
    draw_category_limit,
    heat_map,
    in_sweep,
    outcome_bars,
    outcome_legend,
    small_print,
)

FRAMES = (
    ("texture-poor", "as it is", "Texture-poor", "contrast / the original's"),
    ("occluded", "as it is", "Occluded", "part under instruments"),
    ("occluded", "masked", "Occluded, masked", "part under instruments, masked out"),
    ("specular", "as it is", "Specular", "part under glare"),
    ("noisy", "as it is", "Noisy", "standard deviation of the noise (of 1)"),
    ("blurred", "as it is", "Blurred", "blur (px)"),
)


def refinement_stability_charts(cells: Sequence[Cell], conditions: Sequence[str], data: Path) -> list[Path]:
    """Draw the chart; returns the files written."""
    draw = partial(_draw, cells=cells, conditions=conditions)
    return write_chart(data, draw, (12.6, 7.2), title="Refinement: where it fails")


def _draw(figure: Any, theme: Theme, *, cells: Sequence[Cell], conditions: Sequence[str]) -> None:
    panels = figure.subplots(2, 4).ravel()
    basin = in_sweep(cells, "basin")
    axes = panels[0]
    heat_map(axes, theme, basin, text=lambda cell: f"{cell.trials - cell.wrong - cell.refuses}/{cell.trials}")
    # room for the name of the limit
    axes.set_ylim(-0.5, len({cell.y for cell in basin}) - 0.15)
    draw_category_limit(axes, theme, distinct([cell.x for cell in basin]), basin)
    axes.set_title("Basin: right of all starts")
    axes.set_xlabel("start: rotation (°)", fontsize=9.5)
    axes.set_ylabel("start: shift (mm)", fontsize=9.5)
    for axes, (sweep, series, title, label) in zip(panels[1:], FRAMES, strict=False):
        own = in_sweep(cells, sweep, series)
        if own:
            outcome_bars(axes, theme, own)
        axes.set_title(title)
        axes.set_xlabel(label, fontsize=9.5)
        axes.tick_params(axis="x", labelsize=8)
    outcome_legend(panels[-1], theme)
    small_print(
        figure,
        theme,
        "Sample case, 960x720 px at 300 mm (0.058 mm a pixel); bad frames start 3° and 4 mm (about 60 px) off; wrong: "
        "accepted, beyond 2 px or 1°, and further off than twice the stated error.",
        conditions,
        legend=False,
    )
