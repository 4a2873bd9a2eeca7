"""Chart of the sweeps of the colouring."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from oneframe.charts.page import Theme, write_chart

from ..sweeps.cells import Cell
from .log_axes import log_axes, log_y
from .stability_panels import answer_legend, in_sweep, lines, small_print

WRONG_CODES, WRONG_PART = 8.0, 0.05


@dataclass(frozen=True)
class Panel:
    """A sweep as a panel: its title, the label of its x axis, whether that is logarithmic, and what its errors are."""

    sweep: str
    title: str
    label: str
    log: bool
    codes: bool


PANELS = (
    Panel("pose error", "Pose error", "error of the pose (px)", True, True),
    Panel("incidence", "Grazing angles", "angle between ray and normal (°)", False, True),
    Panel("magnification", "Frame resolution", "enlargement of the frame", True, True),
    Panel("mesh density", "Mesh density", "distance of the vertices (px of the frame)", True, True),
    Panel("scale", "Acne against scale", "working distance (mm)", True, False),
    Panel("focal length", "Acne against focal length", "focal length (px)", True, False),
    Panel("thin walls", "Thin walls", "distance of the sides (pixel footprints)", True, False),
)

LEGENDS: dict[str, str | tuple[float, float]] = {
    "incidence": "upper left",
    "mesh density": (0.05, 0.12),
    "magnification": (0.55, 0.06),
}
"""Where there are no points."""


def colouring_stability_charts(cells: Sequence[Cell], conditions: Sequence[str], data: Path) -> list[Path]:
    """Draw the chart; returns the files written."""
    draw = partial(_draw, cells=cells, conditions=conditions)
    return write_chart(data, draw, (12.6, 7.6), title="Colour: where it fails")


def _draw(figure: Any, theme: Theme, *, cells: Sequence[Cell], conditions: Sequence[str]) -> None:
    panels = figure.subplots(2, 4).ravel()
    for axes, panel in zip(panels, PANELS, strict=False):
        own = in_sweep(cells, panel.sweep)
        if panel.log:
            log_axes(axes, [cell.x for cell in own if cell.x > 0])
        if panel.codes:
            log_y(axes, 0.003, 200)
            lines(
                axes,
                theme,
                [cell for cell in own if cell.x > 0 or not panel.log],
                floor=0.004,
                wrong_above=WRONG_CODES,
                label_at=0.05,
            )
            axes.set_ylabel("mean colour error (of 255)", fontsize=9.5)
        else:
            axes.set_ylim(-0.03, 1.15)
            axes.set_yticks([0, 0.5, 1], ["0", "50 %", "100 %"])
            lines(axes, theme, own, wrong_above=WRONG_PART, label_at=0.2)
            leak = panel.sweep == "thin walls"
            axes.set_ylabel("hidden, but painted" if leak else "seen, but left grey", fontsize=9.5)
        axes.set_title(panel.title)
        axes.set_xlabel(panel.label, fontsize=9.5)
        axes.tick_params(labelsize=9)
        if len({cell.series for cell in own}) > 1:
            place = LEGENDS.get(panel.sweep, "lower right" if panel.codes else "center left")
            axes.legend(loc=place, fontsize=8.5, frameon=False, labelcolor="linecolor")
    panels[-1].axis("off")
    panels[-1].text(
        0, 0.5,
        "Surfaces whose colour is known at every point:\nwaves of 18 px. A layer nearer to the one above\nthan "
        "TOLERANCE_PX is painted from less than\na pixel beside, which does not count as wrong.\n\nPhotographs "
        "(bloster): medians of 14; the error\nthat is added to that of the published pose, or\nof surface seen "
        "within 30° of the front.",
        va="center", fontsize=9.5, color=theme.text, transform=panels[-1].transAxes,
    )  # fmt: skip
    answer_legend(figure, theme)
    small_print(figure, theme, "Views by Cycles, 480x360 px; photographs 1920x1080 px, raster.", conditions)
