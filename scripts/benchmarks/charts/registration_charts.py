"""Charts of the registration: bad frames, where it ends, and the corrected source. Rendered is not real: it is said."""

from collections.abc import Callable, Sequence
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from oneframe.charts.page import WARNING, Theme, write_chart
from oneframe.registration.verdict import LEAST_ACCEPTED

from ..alignment.registration_trials import RegistrationTrial, share
from ..sweeps.degradations import CLEAN, DEGRADATIONS, WRONG
from .log_axes import log_y, short_number
from .stability_panels import bottom_legend, distinct, small_print

Trials = Sequence[RegistrationTrial]
NAMES = {
    "bloster": "real: bloster",
    "lmo": "real: LM-O",
    "sample": "rendered: sample",
    "bones": "rendered: temporal bones",
}
LIMITS = (
    # kind, title, label, edges of the bins
    ("contrast", "Texture: contrast", "contrast of source and frame / the original's", ()),
    ("paint", "Texture: fine paint", "blur of source and frame (px)", ()),
    ("size", "Size in the frame", "longer side of the surface shown, from (px)", (0, 60, 100, 130, 170, 340, 641)),
    ("overlap", "Angle to the source", "angle between both views, from (°)", (0, 15, 25, 35, 50, 65, 90, 120, 181)),
    ("light", "Light", "light, from where the source has it (°)", ()),
)
LARGEST_WRONG = 0.01
SMALL = (
    "Share of all frames that is accepted and right; bands: 95 %, by a bootstrap over sources. Wrong: accepted, but "
)
SMALL += "off by more than 2°, 2 % of the distance or 5 px at 640 px."


def registration_charts(rows: Trials, conditions: Sequence[str], out: Path) -> list[Path]:
    """Draw all charts of which there are rows into a folder; returns the files written."""
    written = []
    for name, draw, size, title in (
        ("registration_grid", _grid, (12.6, 9.6), "Registration of bad frames"),
        ("stability_registration", _limits, (12.6, 7.2), "Registration: where it ends"),
        ("registration_correction", _corrections, (12.6, 4.6), "The source's pose corrected by further frames"),
    ):
        written += write_chart(out / f"{name}.csv", partial(draw, rows=rows, conditions=conditions), size, title=title)
    return written


def _look(theme: Theme, scene: str) -> dict[str, Any]:
    """Real is drawn solid, rendered dashed and hollow."""
    colour = {"bloster": theme.series[0], "sample": theme.series[2], "lmo": theme.text}.get(scene, theme.muted)
    rendered = NAMES[scene].startswith("rendered")
    return {
        "color": colour, "marker": "o", "markersize": 5, "linestyle": (0, (4, 2)) if rendered else "-",
        "markerfacecolor": theme.background if rendered else colour, "label": NAMES[scene],
    }  # fmt: skip


def _share_panel(axes: Any, theme: Theme, groups: Sequence[tuple[str, Trials]]) -> None:
    """Draw the share found at each setting, a line a data set; how many are wrong stands beside a cross."""
    for scene in NAMES:
        own = [(place, [row for row in rows if row.scene == scene]) for place, (_, rows) in enumerate(groups)]
        drawn = [(place, *share(rows, lambda row: row.found)) for place, rows in own if rows]
        if not drawn:
            continue
        x, middle, low, high = np.array(drawn).T
        look = _look(theme, scene)
        axes.plot(x, middle, linewidth=1.6, **look)
        axes.fill_between(x, low, high, color=look["color"], alpha=0.15, linewidth=0)
        for place, rows in own:
            if wrong := sum(row.wrong for row in rows):
                axes.plot(place, wrong / len(rows), "X", color=theme.series[WARNING], markersize=8, zorder=4)
                text = f"{wrong} of {len(rows)}"
                axes.annotate(
                    text, (place, wrong / len(rows)), (0, 6), textcoords="offset points", ha="center", fontsize=8
                )
    axes.set(ylim=(-0.04, 1.08), xlim=(-0.4, len(groups) - 0.6))
    axes.set_yticks([0, 0.5, 1], ["0", "50 %", "100 %"])
    axes.set_xticks(range(len(groups)), [label for label, _ in groups], fontsize=9)
    axes.grid(axis="y", linewidth=0.8)


def _grid(figure: Any, theme: Theme, *, rows: Trials, conditions: Sequence[str]) -> None:
    own = [row for row in rows if row.part == "grid"]
    panels = figure.subplots(3, 4).ravel()
    for axes, (kind, how) in zip(panels, DEGRADATIONS.items(), strict=False):
        groups = [
            (short_number(amount), [row for row in own if _at(row, kind, amount, amount == how.clean)])
            for amount in how.amounts
        ]
        _share_panel(axes, theme, groups)
        axes.set_title(kind.capitalize() if kind.islower() else kind)
        axes.set_xlabel(how.label, fontsize=9.5)
    _wrong_panel(panels[10], theme, own)
    _threshold_panel(panels[11], theme, own)
    _legend(figure, theme, own)
    small_print(figure, theme, SMALL, conditions)


def _at(row: RegistrationTrial, kind: str, amount: float, clean: bool) -> bool:
    return row.kind == CLEAN if clean else row.kind == kind and row.amount == amount


def _wrong_panel(axes: Any, theme: Theme, own: Trials) -> None:
    """Write how many images that do not show the surface, or mirrored, are accepted."""
    axes.axis("off")
    axes.set_title("Wrong images accepted")
    for place, scene in enumerate(distinct([row.scene for row in own])):
        counts = []
        for kind in WRONG:
            rows = [row for row in own if (row.scene, row.kind) == (scene, kind)]
            counts.append(f"{kind}: {sum(row.wrong for row in rows)} of {len(rows)}")
        text = "\n  ".join([NAMES[scene], *counts])
        axes.text(0, 0.78 - 0.33 * place, text, fontsize=9.5, color=_look(theme, scene)["color"])


def _threshold_panel(axes: Any, theme: Theme, own: Trials) -> None:
    """Draw wrong poses of those accepted against the share found, as the probability that is accepted is swept."""
    for scene in distinct([row.scene for row in own]):
        rows, points = [row for row in own if row.scene == scene], []
        showing = sum(row.kind not in WRONG for row in rows)
        levels = sorted({row.probability for row in rows if np.isfinite(row.error_deg)} | {LEAST_ACCEPTED})
        for level in levels:
            accepted = [row for row in rows if row.probability >= level and not np.isnan(row.error_deg)]
            right = sum(row.right for row in accepted)
            points.append((right / max(showing, 1), (len(accepted) - right) / max(len(accepted), 1)))
        look = _look(theme, scene) | {"marker": ""}
        axes.plot(*np.array(points).T, linewidth=1.6, **look)
        axes.plot(*points[levels.index(LEAST_ACCEPTED)], "D", color=look["color"], markersize=6)
    axes.axhline(LARGEST_WRONG, color=theme.series[WARNING], linewidth=1, linestyle=(0, (1, 2)))
    axes.set_yticks([0, 0.01, 0.02, 0.04, 0.06], ["0", "1 %", "2 %", "4 %", "6 %"])
    axes.set_ylim(-0.002, 0.065)
    axes.set(xlim=(0, 1.05))
    axes.set_xticks([0, 0.5, 1], ["0", "50 %", "100 %"])
    axes.grid(linewidth=0.8)
    axes.set_title("Wrong of those accepted")
    axes.set_xlabel("share found (diamond: as accepted)", fontsize=9.5)


def _limits(figure: Any, theme: Theme, *, rows: Trials, conditions: Sequence[str]) -> None:
    panels = figure.subplots(2, 3).ravel()
    for axes, (kind, title, label, edges) in zip(panels, LIMITS, strict=False):
        own = [row for row in rows if row.kind == kind and row.part == "limits"]
        value: Callable[[RegistrationTrial], float] = lambda row: row.amount  # noqa: E731
        if kind == "overlap":
            own += [row for row in rows if row.part == "photographs"]
            value = lambda row: row.angle_deg  # noqa: E731
        if edges:
            groups = [(f"{a}–", [row for row in own if a <= value(row) < b]) for a, b in pairwise(edges)]
        else:
            groups = [
                (short_number(x), [row for row in own if row.amount == x]) for x in distinct([r.amount for r in own])
            ]
        _share_panel(axes, theme, [(each, some) for each, some in groups if some])
        axes.set_title(title)
        axes.set_xlabel(label, fontsize=9.5)
    panels[-1].axis("off")
    _legend(figure, theme, [row for row in rows if row.part in ("limits", "photographs")])
    small_print(
        figure, theme, f"{SMALL} The sample's light moves with the lens, bloster's stays in the room.", conditions
    )


def _corrections(figure: Any, theme: Theme, *, rows: Trials, conditions: Sequence[str]) -> None:
    panels = figure.subplots(1, 3, sharey=True)
    for axes, kind, title, label in zip(
        panels,
        ("pose", "surface", "frames"),
        ("Source's pose off", "Surface off, and the pose by 4°", "Frames, nearest first; pose off by 4°"),
        ("rotation and 0.5 % of the distance a degree (°)", "error of the surface (mm, root mean square)", "frames"),
        strict=True,
    ):
        own = [row for row in rows if row.part == "correction" and row.kind == kind]
        labels = distinct([(row.amount, f"{row.amount:g}") for row in sorted(own, key=lambda row: row.amount)])
        log_y(axes, 0.01, 20)
        for scene in distinct([row.scene for row in own]):
            some = [row for row in own if row.scene == scene]
            look, x = _look(theme, scene), [[each for each, _ in labels].index(row.amount) for row in some]
            y = np.array([max(row.error_deg, 0.011) if np.isfinite(row.error_deg) else np.nan for row in some])
            axes.plot(x, y, **look | {"linestyle": "none"})
            found = [(a, b) for a, b in zip(x, y, strict=True) if np.isfinite(b)]
            at = sorted({a for a, _ in found})
            medians = [np.median([b for a, b in found if a == place]) for place in at]
            axes.plot(at, medians, **look | {"marker": "", "label": ""})
            refused = [place for place, value in zip(x, y, strict=True) if np.isnan(value)]
            axes.plot(refused, [15] * len(refused), "x", color=look["color"])
        axes.set_xticks(range(len(labels)), [text for _, text in labels])
        axes.axhline(0.5, color=theme.series[WARNING], linewidth=1, linestyle=(0, (1, 2)))
        axes.grid(axis="y", linewidth=0.8)
        axes.set_title(title)
        axes.set_xlabel(label, fontsize=9.5)
    panels[0].set_ylabel("rotation error left (°)", fontsize=9.5)
    _legend(figure, theme, [row for row in rows if row.part == "correction"])
    text = "A point a source and draw, lines: medians; crosses at the top: refused; dotted: the goal of 0.5°."
    small_print(figure, theme, text, conditions)


def _legend(figure: Any, theme: Theme, rows: Trials) -> None:
    from matplotlib.lines import Line2D

    handles = [Line2D([], [], **_look(theme, scene)) for scene in NAMES if scene in {row.scene for row in rows}]
    cross = Line2D([], [], color=theme.series[WARNING], marker="X", linestyle="none", label="accepted and wrong")
    bottom_legend(figure, [*handles, cross])
