"""Panels that all charts of stability share: outcomes as bars, errors as lines, failures as a heat map; the limits."""

import math
import textwrap
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from oneframe.charts.page import OURS, WARNING, Theme, note

from ..figures import conditions_note
from ..sweeps.cells import ANSWERS, Answer, Cell
from .log_axes import short_number

MARKERS: dict[Answer, str] = {"works": "o", "warns": "^", "falls back": "s", "refuses": "x"}
"""How a point shows the software's answer."""
SMALL_PRINT_WIDTH = 165
"""Characters of small print across a chart."""
ANSWER_NAMES: dict[Answer, str] = {
    "works": "result without a word",
    "warns": "result with a warning",
    "falls back": "falls back to grey",
    "refuses": "refuses",
}


def in_sweep(cells: Sequence[Cell], sweep: str, series: str | None = None) -> list[Cell]:
    """The cells of a sweep, of one of its series if given, in the order of the table."""
    return [cell for cell in cells if cell.sweep == sweep and series in (None, cell.series)]


def distinct(values: Sequence[Any]) -> list[Any]:
    """The different values, in the order in which they come."""
    return list(dict.fromkeys(values))


# --- outcomes --------------------------------------------------------------------------------------------------------


def outcome_parts(cells: Sequence[Cell]) -> dict[str, float]:
    """Fractions of the trials of some cells by outcome, from right to wrong without a word."""
    total = sum(cell.trials for cell in cells)
    wrong, silent = sum(cell.wrong for cell in cells), sum(cell.silent for cell in cells)
    works, refuses = sum(cell.works for cell in cells), sum(cell.refuses for cell in cells)
    parts = {
        "right": works - silent,
        "right, with a warning": total - works - refuses - (wrong - silent),
        "refused": refuses,
        "wrong, with a warning": wrong - silent,
        "wrong, without a word": silent,
    }
    return {name: count / total for name, count in parts.items()}


def outcome_looks(theme: Theme) -> dict[str, dict[str, Any]]:
    """How the parts of :func:`outcome_parts` are drawn."""
    ours, warning = theme.series[OURS], theme.series[WARNING]
    return {
        "right": {"color": ours},
        "right, with a warning": {"color": _mixed(ours, theme.background, 0.5)},
        "refused": {"color": theme.grid},
        "wrong, with a warning": {"color": _mixed(warning, theme.background, 0.5)},
        "wrong, without a word": {"color": warning},
    }


def outcome_bars(axes: Any, theme: Theme, cells: Sequence[Cell], *, limit_below: bool = False) -> list[float]:
    """Draw a stacked bar for each value of ``x``, over all cells with it, and the limit; returns the values."""
    values, looks = distinct([cell.x for cell in cells]), outcome_looks(theme)
    for position, value in enumerate(values):
        bottom = 0.0
        for name, part in outcome_parts([cell for cell in cells if cell.x == value]).items():
            if part > 0:
                axes.bar(position, part, bottom=bottom, width=0.82, **looks[name])
            bottom += part
    _category_axis(axes, values)
    axes.set(ylim=(0, 1.16), yticks=[0, 0.5, 1])
    axes.set_yticks([0, 0.5, 1], ["0", "50 %", "100 %"])
    axes.grid(axis="y", linewidth=0.8)
    draw_category_limit(axes, theme, values, cells, below=limit_below)
    return values


def _category_axis(axes: Any, values: Sequence[float]) -> None:
    axes.set_xticks(range(len(values)), [short_number(value) for value in values])
    axes.set_xlim(-0.6, len(values) - 0.4)
    axes.tick_params(axis="x", length=0)


def draw_category_limit(
    axes: Any, theme: Theme, values: Sequence[float], cells: Sequence[Cell], *, below: bool = False
) -> None:
    """Draw the limits of some cells between their values; ``below``: a value equal to the limit is on its good side
    from above."""
    for constant, limit in limits_of(cells):
        rising = values[-1] > values[0]
        before = sum(value < limit or (value == limit and not below) for value in values)
        at = (before if rising else len(values) - before) - 0.5
        axes.axvline(at, color=theme.text, linewidth=1.2, linestyle=(0, (4, 2)))
        _limit_label(axes, theme, at, constant)


def limits_of(cells: Sequence[Cell]) -> list[tuple[str, float]]:
    """The different limits of some cells: constant and value."""
    return distinct([(cell.constant, cell.limit) for cell in cells if cell.constant])


def _limit_label(axes: Any, theme: Theme, at: float, constant: str, label_at: float | None = None) -> None:
    """Write the name of a limit beside its line: across it above the bars, or along it from a part of the height."""
    upright, height = label_at is not None, 1.0 if label_at is None else label_at
    right = upright or _part_along(axes, at, *axes.get_xlim()) > 0.5
    axes.annotate(
        constant,
        (at, height),
        (-3 if right else 3, -2 if height > 0.5 else 2),
        xycoords=("data", "axes fraction"),
        textcoords="offset points",
        ha="right" if right else "left",
        va="top" if height > 0.5 else "bottom",
        rotation=90 if upright else 0,
        fontsize=7.5,
        color=theme.text,
        bbox={"facecolor": theme.background, "edgecolor": "none", "pad": 0.6, "alpha": 0.8},
        annotation_clip=False,
    )


def _part_along(axes: Any, at: float, low: float, high: float) -> float:
    if axes.get_xscale() == "log":
        return math.log(at / low) / math.log(high / low)
    return (at - low) / (high - low)


# --- lines -----------------------------------------------------------------------------------------------------------


def lines(
    axes: Any,
    theme: Theme,
    cells: Sequence[Cell],
    *,
    quantity: Callable[[Cell], float] = lambda cell: cell.error,
    floor: float | None = None,
    wrong_above: float | None = None,
    label_at: float = 1.0,
) -> None:
    """Draw a quantity against ``x``, a line a series, with a marker for each answer; both axes are set before.

    Points without a value are drawn at the lower edge.

    Parameters
    ----------
    quantity
        Of a cell.
    floor
        Smaller values are drawn there: a logarithmic axis has no zero.
    wrong_above
        From where results count as wrong: a line.
    label_at
        Where the names of limits begin, as a part of the height: where there are no points.
    """
    names = distinct([cell.series for cell in cells])
    for number, name in enumerate(names):
        own = [cell for cell in cells if cell.series == name]
        colour = (*theme.series[: min(len(names), 3)], theme.muted)[min(number, 3)]
        x = np.array([cell.x for cell in own])
        y = np.array([quantity(cell) for cell in own])
        y = np.where(np.isfinite(y), y, np.nan)
        if floor is not None:
            y = np.where(np.isnan(y), np.nan, np.maximum(y, floor))
        # equal lines must not hide each other: the first is wide, and the last one thin
        width, size = 1.3 + 1.6 * (len(names) - 1 - number), 26 + 26 * (len(names) - 1 - number)
        shade = 1.0 if number == len(names) - 1 else 0.55
        axes.plot(x, y, color=colour, linewidth=width, alpha=shade, label=name)
        for answer in ANSWERS:
            chosen = np.array([cell.answer == answer for cell in own])
            look: dict[str, Any] = {"marker": MARKERS[answer], "s": size, "zorder": 3, "linewidths": 1.4}
            hollow = {"facecolors": theme.background, "edgecolors": colour}
            look |= hollow if answer == "falls back" else {"color": colour}
            _points(axes, x[chosen], y[chosen], look, 0.02 + 0.05 * number)
    if wrong_above is not None:
        axes.axhline(wrong_above, color=theme.series[WARNING], linewidth=1, linestyle=(0, (1, 2)))
    for constant, limit in limits_of(cells):
        axes.axvline(limit, color=theme.text, linewidth=1.2, linestyle=(0, (4, 2)))
        low, high = axes.get_xlim()
        if min(low, high) <= limit <= max(low, high):
            _limit_label(axes, theme, limit, constant, label_at)
    axes.grid(axis="y", linewidth=0.8)


def _points(axes: Any, x: np.ndarray, y: np.ndarray, look: dict[str, Any], low: float) -> None:
    """Draw points; those without a value at this part of the height."""
    known = ~np.isnan(y)
    axes.scatter(x[known], y[known], **look)
    if not known.all():
        at = np.full(np.count_nonzero(~known), low)
        axes.scatter(x[~known], at, transform=axes.get_xaxis_transform(), clip_on=False, **look)


# --- heat maps -------------------------------------------------------------------------------------------------------


def heat_map(axes: Any, theme: Theme, cells: Sequence[Cell], *, text: Callable[[Cell], str]) -> None:
    """Draw a box for each (x, y), filled from left to right by outcome as a bar of :func:`outcome_bars` is."""
    from matplotlib.patches import Rectangle

    columns, rows = distinct([cell.x for cell in cells]), distinct([cell.y for cell in cells])
    looks = outcome_looks(theme)
    for cell in cells:
        column, row = columns.index(cell.x), rows.index(cell.y)
        left = 0.0
        for name, part in outcome_parts([cell]).items():
            corner = column - 0.47 + 0.94 * left, row - 0.46
            axes.add_patch(Rectangle(corner, 0.94 * part, 0.92, linewidth=0, **looks[name]))
            left += part
        # the box may have several colours behind the number
        paper = {"facecolor": theme.background, "edgecolor": "none", "pad": 0.8, "alpha": 0.8}
        axes.text(column, row, text(cell), ha="center", va="center", fontsize=8, color=theme.text, bbox=paper)
    _category_axis(axes, columns)
    axes.set_yticks(range(len(rows)), [short_number(row) for row in rows])
    axes.set_ylim(-0.5, len(rows) - 0.5)
    axes.tick_params(length=0)
    axes.spines[:].set_visible(False)


# --- legends ---------------------------------------------------------------------------------------------------------


def outcome_handles(theme: Theme) -> list[Any]:
    """Legend entries for the bars."""
    from matplotlib.patches import Patch

    return [Patch(label=name, **look) for name, look in reversed(outcome_looks(theme).items())]


def answer_handles(theme: Theme) -> list[Any]:
    """Legend entries for the markers."""
    from matplotlib.lines import Line2D

    return [
        Line2D(
            [],
            [],
            linestyle="none",
            marker=marker,
            color=theme.muted,
            markerfacecolor=theme.background if answer == "falls back" else theme.muted,
            label=ANSWER_NAMES[answer],
        )
        for answer, marker in MARKERS.items()
    ]


def answer_legend(figure: Any, theme: Theme) -> None:
    """A legend below all panels that explains the markers and the lines of limits."""
    from matplotlib.lines import Line2D

    limit = Line2D([], [], color=theme.text, linewidth=1.2, linestyle=(0, (4, 2)), label="limit in the code")
    wrong = Line2D([], [], color=theme.series[WARNING], linestyle=(0, (1, 2)), label="counts as wrong above")
    bottom_legend(figure, [*answer_handles(theme), limit, wrong])


def bottom_legend(figure: Any, handles: Sequence[Any]) -> None:
    """A legend in one line at the bottom, where :func:`small_print` leaves room."""
    figure.legend(
        handles=handles,
        loc="lower left",
        bbox_to_anchor=(0.004, 0.0),
        ncols=len(handles),
        frameon=False,
        fontsize=9,
        columnspacing=1.3,
        handletextpad=0.6,
        borderaxespad=0.3,
    )


def small_print(figure: Any, theme: Theme, text: str, conditions: Sequence[str], *, legend: bool = True) -> None:
    """A text and the conditions below the panels, with room for :func:`bottom_legend` if there is one."""
    rows = [*textwrap.wrap(text, SMALL_PRINT_WIDTH), *textwrap.wrap(conditions_note(conditions), SMALL_PRINT_WIDTH)]
    note(figure, theme, "\n".join([*rows, *((" ", " ") if legend else ())]))


def _mixed(one: str, other: Any, part: float) -> tuple[float, ...]:
    from matplotlib.colors import to_rgb

    return tuple(part * np.array(to_rgb(one)) + (1 - part) * np.array(to_rgb(other)))
