"""Chart of the sweeps of the refinement: its basin of convergence, and bad frames."""

from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any

from oneframe.charts.page import Theme, write_chart

from ..sweeps.cells import Cell
from ..sweeps.refinement import BLOSTER, LMO, MASKED, RENDERED
from .stability_panels import (
    bottom_legend,
    distinct,
    draw_category_limit,
    heat_map,
    in_sweep,
    outcome_bars,
    outcome_handles,
    small_print,
)

SOURCES = (
    (RENDERED, "sample, rendered:\n3 trials of one frame"),
    (BLOSTER, "bloster:\n14 photographs"),
    (LMO, "LM-O:\n12 photographs"),
)
FRAMES = (
    ("texture-poor", "", "Texture-poor", "contrast / the original's"),
    ("occluded", "", "Occluded", "part under instruments"),
    ("occluded", MASKED, "Occluded, masked", "part masked out"),
    ("specular", "", "Specular", "part under glare"),
    ("noisy", "", "Noisy", "standard deviation (of 1)"),
    ("blurred", "", "Blurred", "blur (px)"),
)


def refinement_stability_charts(cells: Sequence[Cell], conditions: Sequence[str], data: Path) -> list[Path]:
    """Draw the chart, a row of panels for each source of frames in the table; returns the files written."""
    sources = [source for source in SOURCES if in_sweep(cells, "basin", source[0])]
    draw = partial(_draw, sources=sources, cells=cells, conditions=conditions)
    return write_chart(data, draw, (15.4, 2.0 + 2.3 * len(sources)), title="Refinement: where it fails")


def _draw(
    figure: Any, theme: Theme, *, sources: Sequence[tuple[str, str]], cells: Sequence[Cell], conditions: Sequence[str]
) -> None:
    rows = figure.subplots(len(sources), 1 + len(FRAMES), squeeze=False, width_ratios=[1.5] + [1] * len(FRAMES))
    for (source, name), panels in zip(sources, rows, strict=True):
        basin = in_sweep(cells, "basin", source)
        axes, last = panels[0], source == sources[-1][0]
        heat_map(axes, theme, basin, text=lambda cell: f"{cell.trials - cell.wrong - cell.refuses}/{cell.trials}")
        # room for the name of the limit
        axes.set_ylim(-0.5, len({cell.y for cell in basin}) - 0.15)
        draw_category_limit(axes, theme, distinct([cell.x for cell in basin]), basin)
        axes.set_ylabel(f"{name}\n\nshift (% of distance)", fontsize=9.5)
        axes.set_xlabel("start: rotation (°)" * last, fontsize=9.5)
        for axes, (sweep, end, title, label) in zip(panels[1:], FRAMES, strict=True):
            outcome_bars(axes, theme, in_sweep(cells, sweep, source + end))
            axes.set_title(title if source == sources[0][0] else "")
            axes.set_xlabel(label * last, fontsize=9.5)
            axes.tick_params(axis="x", labelsize=7)
            if axes is not panels[1]:
                axes.set_yticklabels([])
    rows[0][0].set_title("Basin: right of all starts")
    bottom_legend(figure, outcome_handles(theme))
    small_print(
        figure,
        theme,
        "Photographs are made worse in the box of the object, and refined by its colours. Bad frames start 3° and "
        "1.3 % of the distance (sample: 60 px) off. Wrong: accepted, beyond 2 px or 1° (photographs: 5 px, as their "
        "poses are not exact), and further off than twice the stated error.",
        conditions,
    )
