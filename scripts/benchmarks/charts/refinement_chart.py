"""Chart of the refinement's basin of convergence, and of its verdicts."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from oneframe.charts.page import OURS, WARNING, Theme, note, write_chart
from oneframe.errors import InputError

from ..alignment.refinement_basin import RIGHT_IMAGE, RefinementTrial, Tally
from .log_axes import plain_log_axis, round_ticks

LEAST_PX = 0.05
"""Smaller displacements are drawn as this one."""


def refinement_charts(trials: Sequence[RefinementTrial], data: Path) -> list[Path]:
    """Draw the success for each size of the disturbance, and the errors before and after every refinement.

    Returns
    -------
    The files written.

    Raises
    ------
    InputError
        All trials are of wrong images.
    """
    grid, tally = [trial for trial in trials if trial.image == RIGHT_IMAGE], Tally.of(trials)
    if not grid:
        raise InputError(f"{data.name}: expected trials of the right image to draw, found none; measure with --trials")
    notes = [f"accepted though wrong: {tally.accepted - tally.right_and_accepted} of {tally.accepted} accepted"]
    if tally.wrong_images:
        notes.append(f"accepted on wrong images: {tally.wrong_images_accepted} of {tally.wrong_images}")

    def draw(figure: Any, theme: Theme) -> None:
        left, right = figure.subplots(1, 2)
        _success_panel(left, theme, grid)
        _error_panel(right, theme, grid)
        note(figure, theme, "; ".join(notes))

    return write_chart(data, draw, (10.2, 4.9), title="Refinement of disturbed poses")


def _success_panel(axes: Any, theme: Theme, grid: Sequence[RefinementTrial]) -> None:
    """Draw a cell for each size of rotation and translation: the number of trials that ended right and accepted."""
    from matplotlib.colors import LinearSegmentedColormap, to_rgb

    angles, percents = sorted({trial.angle_deg for trial in grid}), sorted({trial.percent for trial in grid})
    ramp = LinearSegmentedColormap.from_list("success", theme.ramp)
    for row, percent in enumerate(percents):
        for column, angle in enumerate(angles):
            cell = [trial for trial in grid if (trial.angle_deg, trial.percent) == (angle, percent)]
            if not cell:
                continue
            good = sum(trial.right and trial.accepted for trial in cell)
            colour = ramp(good / len(cell))
            axes.add_patch(_square(column, row, colour))
            dark = np.dot(to_rgb(colour), (0.2126, 0.7152, 0.0722)) < 0.45
            axes.text(
                column, row, f"{good} of {len(cell)}", ha="center", va="center", color="#ffffff" if dark else "#0d1117"
            )
    axes.set(xlim=(-0.5, len(angles) - 0.5), ylim=(-0.5, len(percents) - 0.5))
    axes.set_xticks(range(len(angles)), [f"{angle:g}" for angle in angles])
    axes.set_yticks(range(len(percents)), [f"{percent:g}" for percent in percents])
    axes.tick_params(length=0)
    axes.spines[:].set_visible(False)
    axes.set(xlabel="rotation error of the initial pose (°)", ylabel="translation error (% of the distance)")
    axes.set_title("Right and accepted")


def _square(column: int, row: int, colour: Any) -> Any:
    from matplotlib.patches import Rectangle

    return Rectangle((column - 0.48, row - 0.48), 0.96, 0.96, facecolor=colour, edgecolor="none")


def _error_panel(axes: Any, theme: Theme, grid: Sequence[RefinementTrial]) -> None:
    """Draw the displacement of the surface before and after each refinement, by verdict, on log axes."""
    kinds = (
        ("right and accepted", (True, True), {"marker": "o", "color": theme.series[OURS]}),
        ("wrong but accepted", (False, True), {"marker": "X", "color": theme.series[WARNING]}),
        ("right but refused", (True, False), {"marker": "o", "facecolor": "none", "edgecolor": theme.text}),
        ("wrong and refused", (False, False), {"marker": "s", "facecolor": "none", "edgecolor": theme.text}),
    )
    for name, verdicts, look in kinds:
        chosen = [trial for trial in grid if (trial.right, trial.accepted) == verdicts]
        if chosen:
            # 0, of a start at the truth, has no place on a logarithmic axis
            points = np.maximum([(trial.start_px, trial.error_px) for trial in chosen], LEAST_PX)
            axes.scatter(*points.T, s=30, alpha=0.75, linewidth=1.1, label=f"{name}: {len(chosen)}", **look)
    axes.set(xscale="log", yscale="log")
    (left, right), (low, high) = axes.get_xlim(), axes.get_ylim()
    ends = max(left, low), min(right, high)
    if ends[0] < ends[1]:
        axes.plot(ends, ends, color=theme.muted, linewidth=1, linestyle=(0, (4, 3)), label="no change")
    axes.set(xlim=(left, right), ylim=(low, high * 1.6))
    plain_log_axis(axes.xaxis, round_ticks(left, right))
    plain_log_axis(axes.yaxis, round_ticks(low, high))
    axes.grid(linewidth=0.8)
    axes.set(xlabel="displacement of the initial pose (px)", ylabel="displacement of the refined pose (px)")
    axes.set_title("Every refinement")
    axes.legend(loc="best", fontsize=10, handletextpad=0.4, framealpha=1, facecolor=theme.background, edgecolor="none")
