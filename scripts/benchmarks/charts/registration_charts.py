"""Charts of the registration: bad frames, where it ends, and bad photographs beside a network."""

from collections.abc import Callable, Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from ..alignment.registration_trials import RegistrationTrial, share
from ..figures import conditions_note
from ..learning.bad_photographs import LOCATED, NETWORK, REFINED, REGISTERED
from ..sweeps.degradations import CLEAN, DEGRADATIONS, WRONG
from .page import MUTED, OURS, PAPER, PEER, TEXT, WARNING
from .panels import (
    PARTS,
    SERIES,
    Axis,
    Layer,
    Panel,
    band,
    categories,
    distinct,
    draw_chart,
    handle,
    line,
    short_number,
    text,
)

Trials = Sequence[RegistrationTrial]
Groups = Sequence[tuple[str, Trials]]
"""Trials by what is swept, in words."""
NAMES = {
    "bloster": ("real: bloster", OURS),
    "lmo": ("real: LM-O", TEXT),
    "sample": ("rendered: sample", PEER),
    "bones": ("rendered: temporal bones", MUTED),
}
LIMITS = (
    # kind, title, label, edges of the bins
    ("contrast", "Texture: contrast", "contrast of source and frame / the original's", ()),
    ("paint", "Texture: fine paint", "blur of source and frame (px)", ()),
    ("size", "Size in the frame", "longer side of the surface shown, from (px)", (0, 60, 100, 130, 170, 340, 641)),
    ("overlap", "Angle to the source", "angle between both views, from (°)", (0, 15, 25, 35, 50, 65, 90, 120, 181)),
)
SMALL = (
    "Share of all frames that is accepted and right; bands: 95 %, by a bootstrap over sources. Wrong: accepted, but "
    "off by more than 2°, 2 % of the distance or 5 px at 640 px."
)
METHODS = {NETWORK: "o", REFINED: "D", REGISTERED: "s", LOCATED: "^"}
SMALL_BAD = (
    "Right: within 2°, 2 % of the distance and 5 px at 640 px; registered and located ones must be accepted too. The "
    "network sees 128 (bloster: 256) px, and has no verdict: what is not right it gives all the same."
)


def registration_charts(rows: Trials, conditions: Sequence[str], out: Path) -> list[Path]:
    """Draw bad frames and limits into a folder; returns the files written."""
    said, grid = conditions_note(conditions), [row for row in rows if row.part == "grid"]
    bad = [_share_panel(how_title(kind), how.label, by_amount(grid, kind)) for kind, how in DEGRADATIONS.items()]
    bad.append(_wrong_panel(grid))
    ends = [_limit_panel(rows, *each) for each in LIMITS]
    limited = [row for row in rows if row.part in ("limits", "photographs")]
    return [
        draw_chart(
            out / "registration_grid.csv", "Registration of bad frames", [bad[:4], bad[4:8], bad[8:]], (SMALL, said),
            size=(3.15, 2.9), key=_key(grid),
        ),
        draw_chart(
            out / "stability_registration.csv", "Registration: where it ends", [ends[:2], ends[2:]], (SMALL, said),
            size=(4.2, 3.1), key=_key(limited),
        ),
    ]  # fmt: skip


def bad_photographs_chart(rows: Trials, conditions: Sequence[str], data: Path) -> Path:
    """Draw the share right by kind and amount, photographs solid, rendered ones dashed."""
    scenes = distinct([(row.scene, row.real) for row in rows])
    looks = [
        (scene, method, colour, {"marker": METHODS[method], **_real(real, colour)})
        for scene, real in scenes
        for method, colour in zip(METHODS, SERIES, strict=False)
    ]
    panels = []
    for kind, how in DEGRADATIONS.items():
        groups, layers = by_amount(rows, kind), list[Layer]()
        for scene, method, colour, look in looks:
            own = [(x, [t for t in some if (t.scene, t.part) == (scene, method)]) for x, (_, some) in enumerate(groups)]
            drawn = [(x, sum(trial.found for trial in some) / len(some)) for x, some in own if some]
            layers.append(line([x for x, _ in drawn], [part for _, part in drawn], colour, **look))
        panels.append(Panel(how_title(kind), categories(how.label, [name for name, _ in groups]), PARTS, layers))
    key = [handle(name, colour, marker=METHODS[name]) for name, colour in zip(METHODS, SERIES, strict=False)]
    for scene, real in scenes:
        count = len({row.frame for row in rows if row.scene == scene})
        key.append(handle(f"{scene} ({count})", **_real(real, TEXT)))
    title = "Bad photographs: a network, and registration without training"
    small = (SMALL_BAD, conditions_note(conditions))
    return draw_chart(data, title, [panels[:5], panels[5:]], small, size=(2.55, 2.9), key=key)


def _real(real: bool, colour: str) -> dict[str, Any]:
    """Real is drawn solid, rendered dashed and hollow."""
    return {"linestyle": "-" if real else (0, (4, 2)), "markerfacecolor": colour if real else PAPER}


def _look(scene: str) -> tuple[str, dict[str, Any]]:
    name, colour = NAMES[scene]
    return colour, {"marker": "o", "markersize": 5, **_real(name.startswith("real"), colour)}


def how_title(kind: str) -> str:
    """The name of a degradation as a title: JPEG stays as it is."""
    return kind.capitalize() if kind.islower() else kind


def by_amount(rows: Trials, kind: str) -> Groups:
    """The trials of a degradation by its amounts; one of these leaves the frame clean."""
    how = DEGRADATIONS[kind]
    wanted = {amount: (CLEAN, 0.0) if amount == how.clean else (kind, amount) for amount in how.amounts}
    return [(short_number(x), [row for row in rows if (row.kind, row.amount) == each]) for x, each in wanted.items()]


def _share_panel(title: str, label: str, groups: Groups) -> Panel:
    """The share found at each setting, a line a data set; how many are wrong stands beside a cross."""
    layers: list[Layer] = []
    for scene in NAMES:
        own = [(x, [row for row in some if row.scene == scene]) for x, (_, some) in enumerate(groups)]
        if not any(some for _, some in own):
            continue
        x, middle, low, high = np.array([(x, *share(some, lambda row: row.found)) for x, some in own if some]).T
        colour, look = _look(scene)
        layers += [line(x, middle, colour, **look), band(x, low, high, colour)]
        layers += [_cross(x, some) for x, some in own if any(row.wrong for row in some)]
    return Panel(title, categories(label, [name for name, _ in groups]), PARTS, layers)


def _cross(x: float, rows: Trials) -> Layer:
    wrong = sum(row.wrong for row in rows)

    def draw(axes: Any) -> None:
        place = x, wrong / len(rows)
        axes.plot(*place, "X", color=WARNING, markersize=8, zorder=4)
        axes.annotate(f"{wrong} of {len(rows)}", place, (0, 6), textcoords="offset points", ha="center", fontsize=8)

    return draw


def _wrong_panel(rows: Trials) -> Panel:
    """How many images that do not show the surface, or mirrored, are accepted, in words."""
    layers: list[Layer] = [lambda axes: axes.axis("off")]
    for place, scene in enumerate(distinct([row.scene for row in rows])):
        name, colour = NAMES[scene]
        own = {kind: [row for row in rows if (row.scene, row.kind) == (scene, kind)] for kind in WRONG}
        counts = [f"{kind}: {sum(row.wrong for row in some)} of {len(some)}" for kind, some in own.items()]
        layers.append(text((0, 0.78 - 0.33 * place), "\n  ".join([name, *counts]), color=colour))
    return Panel("Wrong images accepted", Axis(), Axis(), layers)


def _limit_panel(rows: Trials, kind: str, title: str, label: str, edges: Sequence[int]) -> Panel:
    own = [row for row in rows if row.kind == kind and row.part == "limits"]
    value: Callable[[RegistrationTrial], float] = lambda row: row.amount  # noqa: E731
    if kind == "overlap":
        own += [row for row in rows if row.part == "photographs"]
        value = lambda row: row.angle_deg  # noqa: E731
    groups: Mapping[str, Trials]
    if edges:
        groups = {f"{a}–": [row for row in own if a <= value(row) < b] for a, b in pairwise(edges)}
    else:
        groups = {short_number(x): [r for r in own if r.amount == x] for x in distinct([r.amount for r in own])}
    return _share_panel(title, label, [(name, some) for name, some in groups.items() if some])


def _key(rows: Trials) -> list[Any]:
    scenes = [scene for scene in NAMES if scene in {row.scene for row in rows}]
    looks = [(NAMES[scene][0], *_look(scene)) for scene in scenes]
    cross = handle("accepted and wrong", WARNING, marker="X", linestyle="none")
    return [*(handle(name, colour, **look) for name, colour, look in looks), cross]
