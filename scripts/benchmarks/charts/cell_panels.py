"""Panels of sweeps' cells: outcomes as bars or boxes, quantities as lines, and the software's limits across them."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from ..sweeps.cells import ANSWERS, Answer, Cell
from .page import DASHED, GRID, MUTED, OURS, PAPER, WARNING
from .panels import (
    DOTTED,
    PARTS,
    SERIES,
    TEXT,
    Layer,
    Panel,
    box,
    categories,
    distinct,
    handle,
    lighter,
    limit,
    line,
    patch,
    rule,
    stack,
)

MARKERS: dict[Answer, str] = {"works": "o", "warns": "^", "falls back": "s", "refuses": "x"}
"""How a point shows the software's answer."""
ANSWER_NAMES = ("result without a word", "result with a warning", "falls back to grey", "refuses")


def in_sweep(cells: Sequence[Cell], sweep: str, series: str | None = None) -> list[Cell]:
    """The cells of a sweep, of one of its series if given, in the order of the table."""
    return [cell for cell in cells if cell.sweep == sweep and series in (None, cell.series)]


def outcome_parts(cells: Sequence[Cell]) -> list[float]:
    """Fractions of the trials: right, right with a warning, refused, wrong with a warning, wrong without a word."""
    total, wrong, silent = (sum(getattr(cell, name) for cell in cells) for name in ("trials", "wrong", "silent"))
    works, refuses = sum(cell.works for cell in cells), sum(cell.refuses for cell in cells)
    counts = works - silent, total - works - refuses - (wrong - silent), refuses, wrong - silent, silent
    return [count / total for count in counts]


def outcome_colours() -> dict[str, Any]:
    """Colour by outcome, in the order of :func:`outcome_parts`."""
    return {
        "right": OURS,
        "right, with a warning": lighter(OURS),
        "refused": GRID,
        "wrong, with a warning": lighter(WARNING),
        "wrong, without a word": WARNING,
    }


def outcome_panel(
    cells: Sequence[Cell], title: str, label: str, *, below: bool = False, more: Sequence[Layer] = ()
) -> Panel:
    """A stacked bar for each value of ``x``, over all cells with it, and the limit.

    ``below``: a value equal to the limit is on its good side from above. ``more`` layers go on top.
    """
    values = distinct([cell.x for cell in cells])
    layers: list[Layer] = []
    for place, value in enumerate(values):
        parts = outcome_parts([cell for cell in cells if cell.x == value])
        layers.append(stack(place, list(zip(parts, outcome_colours().values(), strict=True))))
    return Panel(title, categories(label, values), PARTS, [*layers, *_between(values, cells, below=below), *more])


def _between(values: Sequence[float], cells: Sequence[Cell], *, below: bool = False) -> list[Layer]:
    """The limits of cells between categories."""
    layers = []
    for constant, value in limits_of(cells):
        before = sum(each < value or (each == value and not below) for each in values)
        layers.append(limit((before if values[-1] > values[0] else len(values) - before) - 0.5, constant))
    return layers


def limits_of(cells: Sequence[Cell]) -> list[tuple[str, float]]:
    """The different limits of some cells: constant and value."""
    return distinct([(cell.constant, cell.limit) for cell in cells if cell.constant])


def box_panel(
    cells: Sequence[Cell], title: str, labels: tuple[str, str], words: Callable[[Cell], str], *, below: bool = False
) -> Panel:
    """A box for each (x, y), filled by outcome as the bars of :func:`outcome_panel` are."""
    columns, rows = distinct([cell.x for cell in cells]), distinct([cell.y for cell in cells])
    x, y = categories(labels[0], columns), categories(labels[1], rows)
    layers = [
        box(
            (columns.index(cell.x), rows.index(cell.y)),
            list(zip(outcome_parts([cell]), outcome_colours().values(), strict=True)),
            words(cell),
        )
        for cell in cells
    ]
    return Panel(title, x, y, [*layers, *_between(columns, cells, below=below)])


def with_lines(
    panel: Panel,
    cells: Sequence[Cell],
    *,
    quantity: str = "error",
    by: Callable[[Cell], str] = lambda cell: cell.series,
    wrong: float | None = None,
    label_at: float | None = 1.0,
    style: str = "-",
) -> Panel:
    """The panel with a quantity against ``x``, a line a series, with a marker for each answer.

    Points without a value are drawn at the lower edge, and smaller ones than a logarithmic axis shows just above it.

    Parameters
    ----------
    quantity
        A field of the cells.
    by
        What distinguishes the lines.
    wrong
        From where results count as wrong.
    label_at
        Where the names of limits begin, as a part of the height: where there are no points; ``None`` for no limits.
    style
        Of the lines.
    """
    if panel.x.log:
        cells = [cell for cell in cells if cell.x > 0]
    names, layers = distinct([by(cell) for cell in cells]), list[Layer]()
    for number, name in enumerate(names):
        own, after = [cell for cell in cells if by(cell) == name], len(names) - 1 - number
        places = [cell.x for cell in own]
        values = np.array([getattr(cell, quantity) for cell in own], float)
        values[~np.isfinite(values)] = np.nan
        if panel.y.log and panel.y.ends:
            values = np.where(np.isnan(values), np.nan, np.maximum(values, 1.3 * panel.y.ends[0]))
        # equal lines must not hide each other: the first is wide, and the last one thin
        colour, width = SERIES[number % len(SERIES)], 1.3 + 1.2 * after
        look: dict[str, Any] = {"linewidth": width, "alpha": 0.55 if after else 1.0, "linestyle": style}
        layers.append(line(places, values, colour, name, **look))
        layers += _answers(own, values, colour, 5 + 1.5 * after, 0.02 + 0.05 * number)
    if wrong is not None:
        layers.append(rule(wrong))
    if label_at is not None:
        layers += [limit(value, constant, label_at) for constant, value in limits_of(cells)]
    return replace(panel, layers=[*panel.layers, *layers])


def _answers(cells: Sequence[Cell], values: np.ndarray, colour: str, size: float, low: float) -> list[Layer]:
    """The markers of points; those without a value at this part of the height."""
    layers: list[Layer] = []
    for answer in ANSWERS:
        for cell, value in zip(cells, values, strict=True):
            if cell.answer == answer:
                marks: dict[str, Any] = {
                    "marker": MARKERS[answer],
                    "markersize": size,
                    "zorder": 3,
                    "linestyle": "none",
                }
                if answer == "falls back":
                    marks["markerfacecolor"] = PAPER
                layers.append(
                    _edge(cell.x, low, colour, marks) if np.isnan(value) else line([cell.x], [value], colour, **marks)
                )
    return layers


def _edge(x: float, part: float, colour: str, look: dict[str, Any]) -> Layer:
    return lambda axes: axes.plot(
        [x], [part], color=colour, transform=axes.get_xaxis_transform(), clip_on=False, **look
    )


def outcome_key() -> list[Any]:
    """Legend of bars and boxes."""
    return [patch(name, colour) for name, colour in outcome_colours().items()]


def answer_key() -> list[Any]:
    """Legend of markers, limits and what counts as wrong."""
    looks = zip(ANSWER_NAMES, MARKERS.items(), strict=True)
    return [
        *(
            handle(
                name, MUTED, marker=marker, linestyle="none", markerfacecolor=PAPER if answer == "falls back" else MUTED
            )
            for name, (answer, marker) in looks
        ),
        handle("limit in the code", TEXT, linestyle=DASHED, linewidth=1.2),
        handle("counts as wrong above", WARNING, linestyle=DOTTED),
    ]


def percent_right(cell: Cell) -> str:
    """Percent of the trials that are right."""
    return f"{100 * (1 - cell.failed_part):.0f}"


def right_of_all(cell: Cell) -> str:
    """Number of right trials, of all."""
    return f"{cell.trials - cell.wrong - cell.refuses}/{cell.trials}"
