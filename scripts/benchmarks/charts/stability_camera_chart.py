"""Chart of the sweeps of the camera: how far rendered edges are from where K says."""

from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any

from oneframe.case.precision import EXACT_PX
from oneframe.charts.page import Theme, write_chart

from ..sweeps.cells import Cell
from .log_axes import log_axes, log_y
from .stability_panels import answer_legend, distinct, in_sweep, lines, small_print

PANELS = (
    ("principal point", "Principal point", "distance from the middle (image sizes)", False),
    ("focal length", "Focal length", "focal length (px)", True),
    ("fx / fy", "Pixel aspect", "fx / fy", True),
    ("image height", "Image height", "height of an image 2000 px wide (px)", True),
    ("origin", "Origin of the CT", "distance from the mesh file's origin (mm)", True),
    ("clip range", "Clip range", "radius of the surface / its distance", True),
)
FLOOR_PX, HIGHEST_PX = 1e-4, 300.0


def camera_stability_charts(cells: Sequence[Cell], conditions: Sequence[str], data: Path) -> list[Path]:
    """Draw the chart; returns the files written."""
    draw = partial(_draw, cells=cells, conditions=conditions)
    return write_chart(data, draw, (12.6, 7.6), title="Camera: how far rendered edges are from where K says")


def _draw(figure: Any, theme: Theme, *, cells: Sequence[Cell], conditions: Sequence[str]) -> None:
    panels = figure.subplots(2, 4).ravel()
    for axes, (sweep, title, label, log) in zip(panels, PANELS, strict=False):
        own = [cell for cell in in_sweep(cells, sweep) if cell.x > 0 or not log]
        if log:
            log_axes(axes, [cell.x for cell in own])
        if sweep == "image height":
            axes.invert_xaxis()
        log_y(axes, FLOOR_PX / 2, HIGHEST_PX)
        # the worst of the triangles
        lines(axes, theme, own, quantity=lambda cell: cell.error_95, floor=FLOOR_PX, wrong_above=EXACT_PX)
        axes.set_title(title)
        axes.set_xlabel(label, fontsize=9.5)
        axes.tick_params(labelsize=9)
    for axes in panels[::4]:
        axes.set_ylabel("largest error of edges (px)", fontsize=9.5)
    panels[0].legend(loc="center left", fontsize=9, frameon=False, labelcolor="linecolor")
    _draw_offsets(panels[6], theme, in_sweep(cells, "sub-pixel offset"))
    panels[7].axis("off")
    panels[7].text(
        0, 0.5,
        f"Edges nowhere wrong are drawn at {FLOOR_PX:g} px.\nEvery case goes through files, as a user's\n"
        "does: so do the answers.",
        va="center", fontsize=9.5, color=theme.text, transform=panels[7].transAxes,
    )  # fmt: skip
    answer_legend(figure, theme)
    small_print(figure, theme, "One slanted triangle, 640x480 px where not swept, three turns each.", conditions)


def _draw_offsets(axes: Any, theme: Theme, cells: Sequence[Cell]) -> None:
    """The mean displacement of pictures in x and y by engine."""
    engines = distinct([cell.series for cell in cells])
    for position, engine in enumerate(engines):
        for cell, shift, name in zip(in_sweep(cells, "sub-pixel offset", engine), (-0.17, 0.17), "xy", strict=True):
            colour = theme.series[int(cell.x)]
            axes.bar(
                position + shift,
                max(cell.error_95, FLOOR_PX),
                width=0.3,
                color=colour,
                label=name if position == 0 else None,
            )
    log_y(axes, FLOOR_PX / 2, HIGHEST_PX)
    axes.axhline(EXACT_PX, color=theme.series[1], linewidth=1, linestyle=(0, (1, 2)))
    axes.set_xticks(range(len(engines)), engines, rotation=15)
    axes.tick_params(axis="x", length=0, labelsize=9)
    axes.grid(axis="y", linewidth=0.8)
    axes.set_title("Sub-pixel offset of the picture")
    axes.set_xlabel("largest of nine pictures", fontsize=9.5)
    axes.legend(loc="upper right", fontsize=9, frameon=False, ncols=2)
