"""Chart of what views are worth: errors of photographs' poses against their number, and by the options of rendering."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from oneframe.charts.page import Theme, note, write_chart

from ..learning.pose_trials import PoseTrial, Training
from ..learning.training_scenes import NEUTRAL
from .log_axes import log_y, plain_log_axis

NAMES = {
    NEUTRAL: "default\noptions", "fill": "--unseen\nfill", "vertex": "--colour\nvertex\n(paper)",
    "plain": "plain\nshading", "samples4": "--samples\n4", "cone10": "cone\n10°", "cone35": "cone\n35°",
    "frames": "6 more\nframes",
}  # fmt: skip
SCORES = (("angle_deg", "rotation error (°)", 0.01, 100.0), ("px", "shift of the surface (px of 640)", 0.03, 300.0))
"""Field, label, and range of the axis; medians beyond it, and photographs without a pose, are drawn at its end."""
STAGES = (("network alone", "", "o", "-"), ("then refined by render and flow", "refined_", "D", (0, (4, 3))))
RESAMPLES = 2000


def training_charts(trials: Sequence[PoseTrial], conditions: str, data: Path) -> list[Path]:
    """Draw medians over the photographs with their bootstrap intervals; returns the files written."""
    trainings = list(dict.fromkeys(trial.training for trial in trials))
    steps, longest = min(each.steps for each in trainings), max(each.steps for each in trainings)
    compared = max((each.views for each in trainings if each.dataset != NEUTRAL), default=0)
    scenes = list(dict.fromkeys(each.scene for each in trainings))
    counts = {scene: len({trial.photograph for trial in trials if trial.scene == scene}) for scene in scenes}
    equal = [each for each in trainings if each.steps == steps]
    options = list(dict.fromkeys(each.dataset for each in equal if each.views == compared))

    def draw(figure: Any, theme: Theme) -> None:
        panels = figure.subplots(2, 2, width_ratios=(1, 1.35))
        for (left, right), (score, label, low, high) in zip(panels, SCORES, strict=True):
            for axes in (left, right):
                log_y(axes, low, high)
                axes.set_ylabel(label)
                axes.grid(axis="y", linewidth=0.8)
            for place, scene in enumerate(scenes):
                own = [each for each in equal if each.scene == scene]
                by_views = [each for each in own if each.dataset == NEUTRAL]
                by_option = [each for each in own if each.views == compared]
                most = [each for each in trainings if each.scene == scene and each.steps == longest != steps]
                colour, shift = theme.series[place % len(theme.series)], 0.16 * (place - (len(scenes) - 1) / 2)
                for stage, prefix, marker, line in STAGES:
                    look = {"color": colour, "markerfacecolor": theme.background if prefix else colour}
                    name = f"{scene} ({counts[scene]} photographs): {stage}"
                    for axes, x, chosen, more in (
                        (left, [each.views for each in by_views], by_views, {"linestyle": line, "label": name}),
                        (left, [1.25 * each.views for each in most], most, {"marker": "*", "markersize": 13}),
                        (right, [options.index(each.dataset) + shift for each in by_option], by_option, {}),
                    ):
                        if chosen:
                            median, *ends = np.clip(_medians(trials, chosen, prefix + score), low, high).T
                            style = {"marker": marker, "linestyle": "none", "capsize": 2.5, **look, **more}
                            axes.errorbar(x, median, np.abs(ends - median), clip_on=False, **style)
            left.set_xscale("log")
            plain_log_axis(left.xaxis, sorted({each.views for each in equal}))
            right.set_xticks(range(len(options)), [NAMES.get(option, option) for option in options])
        panels[1, 0].set_xlabel("views")
        panels[0, 0].set_title(f"By the number of views, {steps} steps each; star: {longest} steps")
        panels[0, 1].set_title(f"By the options of rendering, {compared} views, {steps} steps each")
        handles, labels = panels[0, 0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside upper right", ncols=2, frameon=False, fontsize=9.5)
        note(figure, theme, f"Medians over held-out photographs, with 95 % bootstrap intervals. {conditions}")

    return write_chart(data, draw, (12.6, 8.6), title="What views are worth")


def _medians(trials: Sequence[PoseTrial], trainings: Sequence[Training], score: str) -> np.ndarray:
    """``(N, 3)``: median of a score over the photographs of each training, and the ends of its interval."""
    rng, found = np.random.default_rng(0), []
    for training in trainings:
        errors = np.array([getattr(trial, score) for trial in trials if trial.training == training])
        drawn = np.median(errors[rng.integers(len(errors), size=(RESAMPLES, len(errors)))], axis=1)
        found.append([np.median(errors), *np.quantile(drawn, [0.025, 0.975], method="nearest")])
    return np.array(found)
