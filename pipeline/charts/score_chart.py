"""Chart of the scores of a film's frames over time."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ..video.frame_scores import FrameScore
from .page import OURS, PEER, TEXT, WARNING, note, write_chart


def score_chart(frames: Sequence[FrameScore], chosen: Sequence[FrameScore], data: Path) -> Path:
    """Draw score, sharpness and what covers the view over time, with the chosen frames; returns the file written."""
    time_s = np.array([each.time_s for each in frames])

    def draw(figure: Any) -> None:
        top, middle, bottom = figure.subplots(3, 1, sharex=True, height_ratios=(1.5, 1, 1))
        top.fill_between(time_s, [each.total for each in frames], color=OURS, alpha=0.25, linewidth=0)
        top.plot(time_s, [each.total for each in frames], color=OURS, linewidth=1)
        for rank, each in enumerate(chosen, start=1):
            top.plot(each.time_s, each.total, "o", color=WARNING, markersize=7)
            top.annotate(
                str(rank), (each.time_s, each.total), (0, 6), textcoords="offset points", ha="center", fontsize=10,
                color=TEXT,
            )  # fmt: skip
        top.set(ylim=(0, 1.18), yticks=(0, 0.5, 1), ylabel="score")
        middle.plot(time_s, [each.sharpness for each in frames], color=TEXT, linewidth=1, label="sharpness")
        middle.plot(
            time_s, [2.0 ** -abs(each.exposure) for each in frames], color=PEER, linewidth=1,
            linestyle="--", label="exposure: 1 is typical, 0.5 one stop off",
        )  # fmt: skip
        middle.set(ylim=(0, 1.08), yticks=(0, 0.5, 1))
        covered = {"metal and gloves": ("obstructed", WARNING), "glare": ("glare", OURS)}
        for label, (name, series) in covered.items():
            values = [100 * getattr(each, name) for each in frames]
            bottom.plot(time_s, values, color=series, linewidth=1, label=label)
        bottom.set(ylabel="% of the view", xlabel="time (s)")
        bottom.set_ylim(bottom=0)
        for axes in (middle, bottom):
            axes.legend(loc="lower right", bbox_to_anchor=(1, 0.98), ncols=2, fontsize=9.5, borderpad=0)
        for axes in (top, middle, bottom):
            axes.grid(axis="y")
            axes.margins(x=0.01)
        note(figure, f"{len(frames)} frames; points: the chosen ones by rank")

    return write_chart(data, draw, (10.2, 6.6), title="Scores of the frames")
