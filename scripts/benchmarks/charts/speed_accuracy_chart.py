"""Chart of speed against accuracy: a row of axes for each scene, time of a view along x, errors along y."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from oneframe.charts import page
from oneframe.charts.page import Theme, note, write_chart

from ..rendering.speed_accuracy import ENGINE_NAMES, FLOOR, PEER, SpeedPoint, pareto_front
from .log_axes import plain_log_axis, round_ticks

MARKERS = {"projective": "o", "texture": "s", "vertex": "^"}
ERROR, PHOTOGRAPH, SURFACE = "error", "photograph_ssim", "photograph_ssim_surface"
TITLES = {
    ERROR: "against a converged reference",
    PHOTOGRAPH: "against photographs, where the frame saw the surface",
    SURFACE: "against photographs, whole surface",
}
LABELS = {ERROR: "mean colour error (of 255)", PHOTOGRAPH: "1 - SSIM", SURFACE: "1 - SSIM"}
_DIRECTIONS = ((7, 7), (7, -7), (-7, -7), (-7, 7), (9, 0), (-9, 0), (0, 11), (0, -11))
_OFFSETS = [(x * reach, y * reach) for reach in (1, 1.9, 3, 4.4, 6) for x, y in _DIRECTIONS]
"""Where a label may go relative to its point, best first; points of print."""

_Label = tuple[Any, SpeedPoint, float]
"""Axes, point and its error."""
_Marker = tuple[Any, tuple[float, float]]
"""Axes and place, in data."""


def speed_accuracy_charts(points: Sequence[SpeedPoint], conditions: str, data: Path) -> list[Path]:
    """Draw the points with their Pareto front; returns the files written.

    Parameters
    ----------
    points
        All points; each scene has some with an error.
    conditions
        One line of small print: machine and versions.
    data
        The table's file.
    """
    scenes = list(dict.fromkeys(point.scene for point in points))
    scores = [ERROR]
    if np.isfinite([point.photograph_ssim for point in points]).any():
        scores.append(PHOTOGRAPH)
    if any("unseen=fill" in point.more for point in points):
        scores.append(SURFACE)

    def draw(figure: Any, theme: Theme) -> None:
        # an axis of its own keeps the legend clear of title and points
        grid = figure.add_gridspec(1 + len(scenes), len(scores), height_ratios=[0.1, *[1] * len(scenes)])
        _legend(figure.add_subplot(grid[0, :]), theme, points)
        labels: list[_Label] = []
        markers: list[_Marker] = []
        for number, scene in enumerate(scenes, start=1):
            row = [figure.add_subplot(grid[number, column]) for column in range(len(scores))]
            in_scene = [point for point in points if point.scene == scene]
            for score, axes in zip(scores, row, strict=True):
                title = f"{scene}: {TITLES[score]}" if len(scenes) > 1 else TITLES[score]
                drawn, labelled = _draw_scene(axes, theme, in_scene, score, title)
                markers += drawn
                labels += labelled
        note(
            figure,
            theme,
            "Lower left is better. Ours: complete views on disk (colour, depth, masks, ground truth), median and range "
            f"of alternating rounds; PyVista: RGB in memory.\n{conditions}",
        )
        _place(figure, theme, labels, markers)

    size = (6.4 * len(scores), 2.3 + 4.4 * len(scenes))
    return write_chart(data, draw, size, title="Speed against accuracy")


def _errors(points: Sequence[SpeedPoint], score: str) -> np.ndarray:
    values = np.array([getattr(point, score) for point in points], float)
    return values if score == ERROR else 1 - values


def _colour(point: SpeedPoint, theme: Theme) -> str:
    series = {ENGINE_NAMES["cycles"]: page.OURS, ENGINE_NAMES["raster"]: page.WARNING, "PyVista": page.PEER}
    return theme.series[series[point.engine]] if point.engine in series else theme.muted


def _short_name(point: SpeedPoint) -> str:
    """The name without what most points share."""
    if point.kind == PEER:
        return point.name
    return ", ".join(part for part in point.name.split(", ") if part not in ("projective", "1 sample"))


def _draw_scene(
    axes: Any, theme: Theme, points: Sequence[SpeedPoint], score: str, title: str
) -> tuple[list[_Marker], list[_Label]]:
    """Draw one pair of axes; returns all points, and those to label."""
    errors = _errors(points, score)
    judged = [(point, error) for point, error in zip(points, errors, strict=True) if error > 0]
    # two digits: smaller differences are chance
    front = pareto_front([point.ms for point, _ in judged], [float(f"{error:.1e}") for _, error in judged])
    labels = []
    for (point, error), first in zip(judged, front, strict=True):
        colour = _colour(point, theme)
        axes.hlines(error, point.ms_least, point.ms_most, color=colour, linewidth=1.4, alpha=0.5)
        axes.plot(
            point.ms, error, marker=MARKERS.get(point.colour, "o"), markersize=8, color=colour, linestyle="none",
            markerfacecolor=colour if first else theme.background, markeredgewidth=1.5, zorder=3,
        )  # fmt: skip
        if first or point.kind == PEER or _colour(point, theme) == theme.muted:
            labels.append((axes, point, error))
    best = sorted((point.ms, error) for (point, error), first in zip(judged, front, strict=True) if first)
    axes.plot(*zip(*best, strict=True), drawstyle="steps-post", color=theme.text, linewidth=1.1, zorder=2)
    floors = [point for point in points if point.kind == FLOOR]
    for point in floors:
        axes.axvline(point.ms, color=theme.muted, linewidth=1.2, linestyle=(0, (4, 3)), zorder=1)
    axes.set_xscale("log")
    axes.set_yscale("log")
    times = [point.ms for point, _ in judged] + [point.ms for point in floors]
    low, high = min(times) / 1.25, max(times) * 1.6
    axes.set_xlim(low, high)
    plain_log_axis(axes.xaxis, round_ticks(low, high))
    shown = [error for _, error in judged]
    low, high = min(shown) / 1.35, max(shown) * 1.35
    axes.set_ylim(low, high)
    plain_log_axis(axes.yaxis, round_ticks(low, high))
    axes.grid(linewidth=0.8)
    axes.set(title=title, xlabel="time of a view (ms)", ylabel=LABELS[score])
    return [(axes, (point.ms, error)) for point, error in judged], labels


def _legend(axes: Any, theme: Theme, points: Sequence[SpeedPoint]) -> None:
    from matplotlib.lines import Line2D

    entries: dict[str, str] = {}
    for point in points:
        if point.kind != FLOOR:
            entries.setdefault(point.engine, _colour(point, theme))
    handles: list[Any] = [
        Line2D([], [], marker="o", linestyle="none", markersize=8, color=colour, label=name)
        for name, colour in entries.items()
    ]
    handles += [
        Line2D([], [], marker=marker, linestyle="none", markersize=8, color=theme.text, fillstyle="none", label=colour)
        for colour, marker in MARKERS.items()
        if any(point.colour == colour for point in points)
    ]
    handles.append(Line2D([], [], color=theme.text, linewidth=1.1, marker="o", label="Pareto front (filled)"))
    handles += [
        Line2D([], [], color=theme.muted, linewidth=1.2, linestyle=(0, (4, 3)), label=name)
        for name in dict.fromkeys(point.name for point in points if point.kind == FLOOR)
    ]
    axes.axis("off")
    axes.legend(handles=handles, loc="upper left", ncols=5, frameon=False, fontsize=9.5, borderaxespad=0)


def _place(figure: Any, theme: Theme, labels: Sequence[_Label], markers: Sequence[_Marker]) -> None:
    """Write each label beside its point where it covers no other label and as few points as possible."""
    figure.draw_without_rendering()
    # the labels depend on the layout, so it must not change any more
    figure.set_layout_engine("none")
    taken: list[Any] = []
    covered = [(axes, axes.transData.transform(at)) for axes, at in markers]
    for axes, point, error in labels:
        text = axes.annotate(
            _short_name(point), (point.ms, error), (0, 0), textcoords="offset points", fontsize=8.5,
            color=_colour(point, theme), zorder=4,
            bbox={"facecolor": theme.background, "edgecolor": "none", "pad": 0.8},
        )  # fmt: skip
        frame = axes.get_window_extent()
        best, least = _OFFSETS[0], np.inf
        for rank, offset in enumerate(_OFFSETS):
            _move(text, offset)
            box = text.get_window_extent()
            cost = 100.0 * sum(box.overlaps(other) for other in taken)
            cost += 10.0 * sum(box.padded(8).contains(*at) for other, at in covered if other is axes)
            cost += 50.0 * (
                not (frame.x0 <= box.x0 and box.x1 <= frame.x1 and frame.y0 <= box.y0 and box.y1 <= frame.y1)
            )
            cost += rank / 2
            if cost < least:
                best, least = offset, cost
        _move(text, best)
        if _OFFSETS.index(best) >= len(_DIRECTIONS):
            # far away: a line leads to the point
            line = {"arrowstyle": "-", "linewidth": 0.7, "color": _colour(point, theme), "shrinkA": 0, "shrinkB": 5}
            axes.annotate("", (point.ms, error), best, textcoords="offset points", arrowprops=line)
        taken.append(text.get_window_extent())


def _move(text: Any, offset: tuple[float, float]) -> None:
    x, y = offset
    text.set_position(offset)
    text.set(
        ha="left" if x > 0 else "right" if x < 0 else "center", va="bottom" if y > 0 else "top" if y < 0 else "center"
    )
