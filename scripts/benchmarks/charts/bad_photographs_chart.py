"""Chart of spoilt photographs: the share with a right pose, by a network, refined, and registered without training."""

from collections.abc import Sequence
from itertools import product
from pathlib import Path
from typing import Any

from oneframe.charts.page import Theme, write_chart

from ..alignment.registration_trials import RegistrationTrial
from ..learning.bad_photographs import NETWORK, REFINED, REGISTERED
from ..sweeps.degradations import CLEAN, DEGRADATIONS
from .log_axes import short_number
from .stability_panels import bottom_legend, distinct, small_print

MARKERS = {NETWORK: "o", REFINED: "D", REGISTERED: "s"}
SMALL = (
    "Right: within 2°, 2 % of the distance and 5 px at 640 px; registered ones must be accepted too. The network sees "
    "128 (bloster: 256) px, and has no verdict: what is not right it gives all the same."
)


def bad_photographs_chart(rows: Sequence[RegistrationTrial], conditions: Sequence[str], data: Path) -> list[Path]:
    """Draw the share right by kind and amount, photographs solid, rendered ones dashed; returns the files written."""
    counts = {each: len({row.frame for row in rows if row.scene == each}) for each in distinct([r.scene for r in rows])}

    def draw(figure: Any, theme: Theme) -> None:
        from matplotlib.lines import Line2D

        series = dict(zip(MARKERS, theme.series, strict=False))
        scenes: dict[str, dict[str, Any]] = {
            row.scene: {
                "linestyle": "-" if row.real else (0, (4, 2)),
                "markerfacecolor": None if row.real else theme.background,
            }
            for row in rows
        }
        panels = figure.subplots(2, 5, sharey=True).ravel()
        for axes, (kind, how) in zip(panels, DEGRADATIONS.items(), strict=True):
            for scene, method in product(scenes, MARKERS):
                own = [row for row in rows if (row.scene, row.part) == (scene, method)]
                wanted = [(CLEAN, 0.0) if amount == how.clean else (kind, amount) for amount in how.amounts]
                groups = [[row for row in own if (row.kind, row.amount) == each] for each in wanted]
                drawn = [(x, sum(row.found for row in some) / len(some)) for x, some in enumerate(groups) if some]
                look = {"color": series[method], "marker": MARKERS[method], **scenes[scene]}
                axes.plot(*zip(*drawn, strict=True), linewidth=1.6, markersize=5, clip_on=False, **look)
            axes.set_title(kind.capitalize() if kind.islower() else kind)
            axes.set_xticks(range(len(how.amounts)), [short_number(amount) for amount in how.amounts], fontsize=9)
            axes.set_xlabel(how.label, fontsize=9.5)
            axes.set(ylim=(-0.04, 1.06))
            axes.set_yticks([0, 0.5, 1], ["0", "50 %", "100 %"])
            axes.grid(axis="y", linewidth=0.8)
        methods = [Line2D([], [], color=series[each], marker=MARKERS[each], label=each) for each in MARKERS]
        kinds = [
            Line2D([], [], color=theme.text, label=f"{scene} ({counts[scene]})", **look)
            for scene, look in scenes.items()
        ]
        bottom_legend(figure, [*methods, *kinds])
        small_print(figure, theme, SMALL, conditions)

    return write_chart(data, draw, (12.6, 6.6), title="Bad photographs: a network, and registration without training")
