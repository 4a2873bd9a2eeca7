"""The one way in which all topics draw: a chart is rows of panels, a panel is layers on two axes, below it small print.

A layer is a function that draws into matplotlib's axes; what several charts draw is here.
"""

import math
import textwrap
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from .page import DASHED, MUTED, OURS, PAPER, PEER, TEXT, WARNING, note, write_chart

SERIES = (OURS, WARNING, PEER, MUTED)
DOTTED = (0, (1, 2))
MOST_TICKS = 5
SMALL_PRINT_WIDTH = 165
"""Characters of small print across a chart."""

Layer = Callable[[Any], object]


@dataclass(frozen=True)
class Axis:
    """One axis of a panel.

    Attributes
    ----------
    label
        What is along it.
    log
        Whether it is logarithmic.
    ends
        Its range; that of what is drawn if ``None``.
    ticks
        Text by place; round numbers if ``None``.
    """

    label: str = ""
    log: bool = False
    ends: tuple[float, float] | None = None
    ticks: Mapping[float, str] | None = None


PARTS = Axis(ends=(-0.04, 1.12), ticks={0: "0", 0.5: "50 %", 1: "100 %"})
"""From none to all."""


@dataclass(frozen=True)
class Panel:
    """Layers on two axes; ``legend`` is matplotlib's location of one for the layers with a label."""

    title: str
    x: Axis
    y: Axis
    layers: Sequence[Layer] = ()
    legend: Any = None


def draw_chart(
    data: Path,
    title: str,
    rows: Sequence[Sequence[Panel]],
    small: Sequence[str],
    *,
    size: tuple[float, float],
    key: Sequence[Any] = (),
    widths: Sequence[float] | None = None,
) -> Path:
    """Draw a chart beside its data, and return its file.

    Parameters
    ----------
    data, title
        The file of the chart's data, and the chart's title.
    rows
        Rows of panels; short ones leave room at their ends.
    small
        Paragraphs of small print.
    size
        Width and height of a panel, inches.
    key
        Matplotlib's handles of the legend below all panels.
    widths
        Relative widths of the columns.
    """
    columns = max(map(len, rows))

    def draw(figure: Any) -> None:
        grid = figure.subplots(len(rows), columns, squeeze=False, width_ratios=widths)
        for panels, places in zip(rows, grid, strict=True):
            for panel, axes in zip(panels, places, strict=False):
                _draw_panel(axes, panel)
            for axes in places[len(panels) :]:
                axes.axis("off")
        lines = [line for each in small for line in textwrap.wrap(each, int(SMALL_PRINT_WIDTH * width / 12.6))]
        if key:
            figure.legend(
                handles=key, loc="lower left", bbox_to_anchor=(0.004, 0.0), ncols=len(key), columnspacing=1.3,
                handletextpad=0.6, borderaxespad=0.3,
            )  # fmt: skip
            lines += [" ", " "]
        note(figure, "\n".join(lines))

    width, height = size[0] * columns, size[1] * len(rows) + 1.0
    return write_chart(data, draw, (width, height), title=title)


def _draw_panel(axes: Any, panel: Panel) -> None:
    for axis, name in ((panel.x, "x"), (panel.y, "y")):
        if axis.log:
            axes.set(**{f"{name}scale": "log"})
        if axis.ends:
            axes.set(**{f"{name}lim": axis.ends})
    for layer in panel.layers:
        layer(axes)
    for axis, target, limits in ((panel.x, axes.xaxis, axes.get_xlim), (panel.y, axes.yaxis, axes.get_ylim)):
        target.set_label_text(axis.label, fontsize=9.5)
        ticks = axis.ticks
        if ticks is None and axis.log:
            ticks = {tick: short_number(tick) for tick in log_ticks(*sorted(limits()))}
        if ticks is not None:
            target.set_ticks(list(ticks), list(ticks.values()))
            target.minorticks_off()
        target.set_tick_params(labelsize=7.5 if len(ticks or ()) > MOST_TICKS else 9)
    axes.set_title(panel.title)
    axes.grid(axis="y")
    if panel.legend is not None:
        axes.legend(loc=panel.legend)


def log_ticks(low: float, high: float) -> list[float]:
    """Round numbers from ``low`` to ``high`` for a logarithmic axis, at most :data:`MOST_TICKS`."""
    powers = range(math.floor(math.log10(low)), math.ceil(math.log10(high)) + 1)
    ticks: list[float] = []
    for factors, step in (
        ((1, 1.5, 2, 3, 4, 5, 6, 7, 8, 9), 1),
        ((1, 2, 5), 1),
        ((1, 3), 1),
        ((1,), 1),
        ((1,), 2),
        ((1,), 3),
    ):
        places = [float(f"{factor}e{power}") for power in powers[::step] for factor in factors]
        ticks = [place for place in places if low * (1 - 1e-9) <= place <= high * (1 + 1e-9)]
        if len(ticks) <= MOST_TICKS:
            break
    return ticks


def short_number(value: float) -> str:
    """A number in few characters: 12 800 as 12.8k, 5 000 000 as 5M."""
    for factor, name in ((1e9, "G"), (1e6, "M"), (1e3, "k")):
        if abs(value) >= factor:
            return f"{value / factor:g}{name}"
    return f"{value:g}"


def distinct(values: Sequence[Any]) -> list[Any]:
    """The different values, in the order in which they come."""
    return list(dict.fromkeys(values))


def categories(label: str, texts: Sequence[Any]) -> Axis:
    """An axis with a place for each text or number, from 0."""
    named: dict[float, str] = {
        place: each if isinstance(each, str) else short_number(each) for place, each in enumerate(texts)
    }
    return Axis(label, ends=(-0.6, len(named) - 0.4), ticks=named)


# --- layers ----------------------------------------------------------------------------------------------------------


def line(x: Any, y: Any, colour: str, label: str = "_", **look: Any) -> Layer:
    """Points joined by a line; ``look`` as matplotlib's."""
    return lambda axes: axes.plot(x, y, color=colour, label=label, **{"linewidth": 1.6, "markersize": 5, **look})


def band(x: Any, low: Any, high: Any, colour: str) -> Layer:
    """What lies between two lines."""
    return lambda axes: axes.fill_between(x, low, high, color=colour, alpha=0.15, linewidth=0)


def rule(at: float, *, along: str = "y", colour: str = WARNING, style: Any = DOTTED) -> Layer:
    """A line across the panel at a place of one axis."""
    return lambda axes: (axes.axhline if along == "y" else axes.axvline)(at, color=colour, linewidth=1, linestyle=style)


def text(place: tuple[float, float], words: str, **look: Any) -> Layer:
    """Text at a place that is relative to the panel."""
    return lambda axes: axes.text(*place, words, **{"fontsize": 9.5, "transform": axes.transAxes, **look})


def limit(at: float, name: str, height: float | None = None) -> Layer:
    """A limit in the code and the name of its constant: along the line from a height, or across it above the panel."""

    def draw(axes: Any) -> None:
        axes.axvline(at, color=TEXT, linewidth=1.2, linestyle=DASHED)
        low, high = sorted(axes.get_xlim())
        if not low <= at <= high:
            return
        right = height is not None or axes.transData.transform((at, 0.5))[0] > axes.transAxes.transform((0.5, 0))[0]
        axes.annotate(
            name, (at, 1.0 if height is None else height), (-3 if right else 3, -2 if height in (None, 1.0) else 2),
            xycoords=("data", "axes fraction"), textcoords="offset points", fontsize=7.5, annotation_clip=False,
            ha="right" if right else "left", va="top" if height in (None, 1.0) else "bottom",
            rotation=90 if height is not None else 0,
            bbox={"facecolor": PAPER, "edgecolor": "none", "pad": 0.6, "alpha": 0.8},
        )  # fmt: skip

    return draw


def stack(place: float, parts: Sequence[tuple[float, Any]]) -> Layer:
    """A bar of parts in their colours, one on the other."""

    def draw(axes: Any) -> None:
        bottom = 0.0
        for part, colour in parts:
            if part > 0:
                axes.bar(place, part, bottom=bottom, width=0.82, color=colour)
            bottom += part

    return draw


def box(place: tuple[float, float], parts: Sequence[tuple[float, Any]], words: str) -> Layer:
    """A box filled from left to right by parts in their colours, with words in it."""

    def draw(axes: Any) -> None:
        from matplotlib.patches import Rectangle

        left = place[0] - 0.47
        for part, colour in parts:
            axes.add_patch(Rectangle((left, place[1] - 0.46), 0.94 * part, 0.92, linewidth=0, color=colour))
            left += 0.94 * part
        paper = {"facecolor": PAPER, "edgecolor": "none", "pad": 0.8, "alpha": 0.8}
        axes.text(*place, words, ha="center", va="center", fontsize=8, bbox=paper)

    return draw


def handle(label: str, colour: str = TEXT, **look: Any) -> Any:
    """An entry of a legend: a line or a marker."""
    from matplotlib.lines import Line2D

    return Line2D([], [], color=colour, label=label, **look)


def patch(label: str, colour: Any) -> Any:
    """An entry of a legend: a coloured area."""
    from matplotlib.patches import Patch

    return Patch(label=label, color=colour)


def lighter(colour: str) -> tuple[float, ...]:
    """Half of a colour, half of the paper's."""
    from matplotlib.colors import to_rgb

    return tuple(0.5 * np.array(to_rgb(colour)) + 0.5 * np.array(to_rgb(PAPER)))
