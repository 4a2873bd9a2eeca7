"""Charts of the sweeps of poses from landmarks: outcomes beside the peers' failures, and by focal length."""

from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any

from oneframe.charts.page import PEER, WARNING, Theme, write_chart

from ..sweeps.cells import Cell
from ..sweeps.landmarks import LEVELS, OURS, PEERS, SWEEPS
from .log_axes import short_number
from .stability_panels import bottom_legend, distinct, heat_map, in_sweep, outcome_bars, outcome_looks, small_print

LABELS = {
    "number": "number of correspondences",
    "noise": "true click noise (px); stated: 2 px",
    "outliers": "part of the 20 pairs that is 80 px off",
    "spread": "extent of the points / the surface's",
    "coplanarity": "thickness of the points / the surface's",
    "collinearity": "width of points on a plane / the surface's",
    "sign flips": "tilt of nearly flat points (°)",
}
PEER_LOOKS = {"EPnP": (WARNING, "^"), "SQPnP + LM": (PEER, "s")}
PERSPECTIVE = "points 600 px wide at every focal length; wrong: more than 10° or 60 px off"


def focal_chart(data: Path) -> Path:
    """The name that the chart by focal length goes by."""
    return data.with_name(f"{data.stem}_focal{data.suffix}")


def landmark_stability_charts(cells: Sequence[Cell], conditions: Sequence[str], data: Path) -> list[Path]:
    """Draw both charts; returns the files written."""
    written = write_chart(
        data,
        partial(_draw_outcomes, cells=cells, conditions=conditions),
        (12.6, 7.6),
        title="Pose from landmarks: where it fails",
    )
    return written + write_chart(
        focal_chart(data),
        partial(_draw_focal, cells=cells, conditions=conditions),
        (12.6, 7.4),
        title="Pose from landmarks, by focal length: part of the trials that is right",
    )


def _draw_outcomes(figure: Any, theme: Theme, *, cells: Sequence[Cell], conditions: Sequence[str]) -> None:
    """A panel for each sweep, over all focal lengths, and one for the calibration of the region."""
    panels = figure.subplots(2, 4).ravel()
    for axes, sweep in zip(panels, SWEEPS, strict=False):
        values = outcome_bars(axes, theme, in_sweep(cells, sweep.name, OURS), limit_below=sweep.name == "number")
        for name in PEERS:
            colour, marker = PEER_LOOKS[name]
            own = in_sweep(cells, sweep.name, name)
            parts = [_failed_part([cell for cell in own if cell.x == value]) for value in values]
            axes.plot(
                range(len(values)), parts, color=theme.series[colour], marker=marker, markersize=5, linewidth=1.2,
                markeredgecolor=theme.background, markeredgewidth=0.7,
            )  # fmt: skip
        axes.set_title(sweep.name.capitalize())
        axes.set_xlabel(LABELS[sweep.name], fontsize=9.5)
        axes.tick_params(axis="x", labelsize=8)
    _draw_calibration(panels[-1], theme, in_sweep(cells, "calibration"))
    _legend(figure, theme)
    small_print(figure, theme, f"Bars: OneFrame, over focal lengths of 600 to 12 800 px; {PERSPECTIVE}.", conditions)


def _failed_part(cells: Sequence[Cell]) -> float:
    return sum(cell.wrong + cell.refuses for cell in cells) / sum(cell.trials for cell in cells)


def _draw_calibration(axes: Any, theme: Theme, cells: Sequence[Cell]) -> None:
    """Part of the 95 % regions that holds the truth, by ratio of true to stated noise."""
    for name, colour in zip(distinct([cell.series for cell in cells]), (*theme.series, theme.muted), strict=False):
        own = [cell for cell in cells if cell.series == name and cell.y == LEVELS[-1]]
        axes.plot(
            [cell.x for cell in own], [cell.value for cell in own], color=colour, marker="o", markersize=4, label=name
        )
    axes.axhline(LEVELS[-1], color=theme.text, linewidth=1, linestyle=(0, (1, 2)))
    values = distinct([cell.x for cell in cells])
    axes.set(xscale="log", ylim=(0, 1.05))
    axes.set_xticks(values, [short_number(value) for value in values])
    axes.minorticks_off()
    axes.set_yticks([0, 0.5, 0.95], ["0", "50 %", "95 %"])
    axes.grid(axis="y", linewidth=0.8)
    axes.set_title("Truth in the 95 % region")
    axes.set_xlabel("true / stated click noise", fontsize=9.5)
    axes.legend(loc="lower left", frameon=False, fontsize=8.5, borderpad=0)


def _legend(figure: Any, theme: Theme) -> None:
    from matplotlib.lines import Line2D

    handles = _outcome_handles(theme)
    for name, (colour, marker) in PEER_LOOKS.items():
        handles.append(Line2D([], [], color=theme.series[colour], marker=marker, label=f"{name}: wrong or none"))
    bottom_legend(figure, handles)


def _outcome_handles(theme: Theme) -> list[Any]:
    from matplotlib.patches import Patch

    return [Patch(label=name, **look) for name, look in outcome_looks(theme).items()]


def _draw_focal(figure: Any, theme: Theme, *, cells: Sequence[Cell], conditions: Sequence[str]) -> None:
    panels = figure.subplots(2, 4).ravel()
    for axes, sweep in zip(panels, SWEEPS, strict=False):
        own = in_sweep(cells, sweep.name, OURS)
        heat_map(axes, theme, own, text=_percent_right)
        axes.set_title(sweep.name.capitalize())
        axes.set_xlabel(LABELS[sweep.name], fontsize=9.5)
        axes.set_ylabel("focal length (px)", fontsize=9.5)
        axes.tick_params(labelsize=8)
    panels[-1].axis("off")
    panels[-1].text(
        0, 0.5,
        "Number: % of the trials that is right,\nwith or without a warning.",
        va="center", fontsize=10, color=theme.text, transform=panels[-1].transAxes,
    )  # fmt: skip
    bottom_legend(figure, _outcome_handles(theme))
    small_print(figure, theme, f"OneFrame; {PERSPECTIVE}.", conditions)


def _percent_right(cell: Cell) -> str:
    return f"{100 * (1 - cell.failed_part):.0f}"
