"""Chart of speed against accuracy: a row of axes for each scene, time of a view along x, errors along y."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ..rendering.speed_accuracy import FLOOR, SpeedPoint, pareto_front
from ..rendering.speed_accuracy import PEER as OTHER
from .page import DASHED, MUTED, OURS, PAPER, PEER, TEXT, WARNING
from .panels import Axis, Layer, Panel, distinct, draw_chart, handle, line, rule, text

COLOURS = {"Cycles": OURS, "raster": WARNING, "PyVista": PEER, "Eevee": MUTED}
MARKERS = {"projective": "o", "vertex": "^"}
SCORES = (
    ("error", "against a converged reference", "mean colour error (of 255)"),
    ("photograph_ssim", "against photographs, where the frame saw the surface", "1 - SSIM"),
    ("photograph_ssim_surface", "against photographs, whole surface", "1 - SSIM"),
)
IN_LIGHT = (
    ("photograph_error", "against photographs, where the frame saw the surface", "mean colour error (of 255)"),
    ("photograph_ssim", "against photographs, where the frame saw the surface", "1 - SSIM"),
)
"""The scores of lights: a converged reference would be in the frame's own light."""
LIT_TITLE = "Speed against accuracy: the light at the lens"
LIT_SMALL = "Lower left is better. Processor time of a view without its files, median and range of alternating rounds."
SMALL = (
    "Lower left is better. Ours: complete views on disk (colour, depth, masks, ground truth), median and range of "
    "alternating rounds; PyVista: RGB in memory. Numbers: the Pareto front (filled) and PyVista, by time."
)
ROOM = 0.55
"""For the names, as a part of the range of errors, above them."""


def speed_accuracy_chart(points: Sequence[SpeedPoint], conditions: str, data: Path) -> Path:
    """Draw the points of each scene with their Pareto front.

    ``conditions`` is one line of small print, ``data`` the table's file.
    """
    known = SCORES if np.isfinite([point.error for point in points]).any() else IN_LIGHT
    scores = [each for each in known if np.isfinite([getattr(point, each[0]) for point in points]).any()]
    rows = []
    for scene in distinct([point.scene for point in points]):
        own = [point for point in points if point.scene == scene]
        rows.append(
            [_panel(own, field, f"{scene}: {title}", label, every=known is IN_LIGHT) for field, title, label in scores]
        )
    drawn = [point for point in points if point.kind != FLOOR]
    key = [
        handle(name, COLOURS.get(name, MUTED), marker="o", linestyle="none", markersize=8)
        for name in distinct([point.engine for point in drawn])
    ]
    key += [
        handle(name, marker=MARKERS[name], linestyle="none", markersize=8, fillstyle="none")
        for name in MARKERS
        if name in {point.colour for point in drawn}
    ]
    floors = distinct([point.name for point in points if point.kind == FLOOR])
    key += [handle(name, MUTED, linestyle=DASHED, linewidth=1.2) for name in floors]
    title, small = ("Speed against accuracy", SMALL) if known is SCORES else (LIT_TITLE, LIT_SMALL)
    return draw_chart(data, title, rows, (small, conditions), size=(6.0, 4.4), key=key)


def _panel(points: Sequence[SpeedPoint], field: str, title: str, label: str, *, every: bool) -> Panel:
    """``every``: all points have a number and a name, not only the front and other programs."""
    values = [(point, getattr(point, field)) for point in points]
    judged = [(point, 1 - value if "ssim" in field else value) for point, value in values if np.isfinite(value)]
    # two digits: smaller differences are chance
    front = pareto_front([point.ms for point, _ in judged], [float(f"{error:.1e}") for _, error in judged])
    layers: list[Layer] = [
        rule(point.ms, along="x", colour=MUTED, style=DASHED) for point in points if point.kind == FLOOR
    ]
    best = sorted((point.ms, error) for (point, error), first in zip(judged, front, strict=True) if first)
    layers.append(
        line([ms for ms, _ in best], [error for _, error in best], TEXT, drawstyle="steps-post", linewidth=1.1)
    )
    named = list[str]()
    for (point, error), first in sorted(zip(judged, front, strict=True), key=lambda each: each[0][0].ms):
        colour, marker = COLOURS.get(point.engine, MUTED), MARKERS.get(point.colour, "o")
        look: dict[str, Any] = {
            "markersize": 8,
            "markerfacecolor": colour if first else PAPER,
            "markeredgewidth": 1.5,
            "zorder": 3,
        }
        layers.append(line([point.ms_least, point.ms_most], [error, error], colour, linewidth=1.4, alpha=0.5))
        layers.append(line([point.ms], [error], colour, marker=marker, **look))
        if first or point.kind == OTHER or every:
            named.append(f"{len(named) + 1}  {_short_name(point)}")
            layers.append(_number((point.ms, error), len(named), colour))
    layers.append(text((0.6, 0.98), "\n".join(named), va="top", fontsize=8))
    errors, times = [error for _, error in judged], [point.ms for point in points if np.isfinite(point.ms)]
    low, high = min(errors) / 1.35, max(errors) * 1.35
    y = Axis(label, log=True, ends=(low, high * (high / low) ** ROOM))
    return Panel(title, Axis("time of a view (ms)", log=True, ends=(min(times) / 1.4, max(times) * 1.6)), y, layers)


def _number(place: tuple[float, float], number: int, colour: str) -> Layer:
    """A number beside a point, in turn above and below it: the points of a front lie close to each other."""
    up = number % 2
    return lambda axes: axes.annotate(
        str(number), place, (0, 8 if up else -8), textcoords="offset points", fontsize=8.5, color=colour, ha="center",
        va="bottom" if up else "top", bbox={"facecolor": PAPER, "edgecolor": "none", "pad": 0.5},
    )  # fmt: skip


def _short_name(point: SpeedPoint) -> str:
    """The name without what most points share."""
    if point.kind == OTHER:
        return point.name
    return ", ".join(part for part in point.name.split(", ") if part not in ("projective", "1 sample"))
