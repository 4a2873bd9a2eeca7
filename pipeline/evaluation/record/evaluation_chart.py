"""Charts of an evaluation: the scores of all methods with what could be reached, and the cases beside each other."""

import math
import textwrap
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from ...charts.page import DASHED, MUTED, OURS, TEXT, WARNING, chart_path, note, round_ticks_inside, write_chart
from .evaluation_record import ALL, Evaluation
from .evaluation_tables import where_peers_lead

PANELS = {
    "ssim_whole": "SSIM, whole image",
    "ssim_surface": "SSIM, surface",
    "ssim_observed": "SSIM, observed",
    "ssim_aligned": "SSIM, aligned",
    "edge_f": "F-score of edges",
    "sharpness": "sharpness",
}
"""The scores that are drawn, and the titles of their panels."""
CASE_PANELS = ("ssim_whole", "ssim_surface", "ssim_observed", "edge_f")
MOST_CASES = 24
LINE_LETTERS = 140
"""Most letters of a line below the chart."""


def evaluation_charts(evaluation: Evaluation, data: Path) -> list[Path]:
    """Draw the means over all cases beside ``data``; of several cases also each one, with ``_cases`` in the name.

    Returns
    -------
    The files written.
    """
    names = [case.name for case in evaluation.cases]
    overall = ALL if len(names) > 1 else names[0]
    file, *by_case = chart_files(data, len(names))
    return [_method_chart(evaluation, overall, file), *(_case_chart(evaluation, names, each) for each in by_case)]


def chart_files(data: Path, cases: int) -> list[Path]:
    """The files of :func:`evaluation_charts` of so many cases."""
    files = [data, data.with_stem(f"{data.stem}_cases")]
    return list(map(chart_path, files if 1 < cases <= MOST_CASES else files[:1]))


def _method_chart(evaluation: Evaluation, case: str, data: Path) -> Path:
    """One panel for each score, one row for each method: mean, confidence interval, and the bound."""
    methods, lines = evaluation.ran, _explanations(evaluation, case)

    def draw(figure: Any) -> None:
        for axes, (score, title) in zip(figure.subplots(2, 3, sharey=True).flat, PANELS.items(), strict=True):
            bound = evaluation.bound_of(case, score)
            if bound is not None and not math.isnan(bound.mean):
                if not math.isnan(bound.low):
                    axes.axvspan(bound.low, bound.high, color=MUTED, alpha=0.25, linewidth=0)
                axes.axvline(bound.mean, color=MUTED, linewidth=1.4, linestyle=DASHED)
            for row, method in enumerate(methods):
                found = evaluation.mean(case, method.name, score)
                if not math.isfinite(found.mean):
                    continue
                colour, marker = (WARNING, "^") if method.peer else (OURS, "o")
                if not math.isnan(found.low):
                    axes.hlines(row, found.low, found.high, color=colour, linewidth=2.2)
                if not math.isnan(found.worst):
                    axes.plot(found.worst, row, marker="|", color=colour, markersize=9)
                axes.plot(found.mean, row, marker=marker, color=colour, markersize=7)
                axes.annotate(
                    f"{found.mean:.3f}", (found.mean, row), (0, 7), textcoords="offset points", ha="center",
                    fontsize=9, color=colour,
                )  # fmt: skip
            axes.set_title(title)
            axes.set(ylim=(len(methods) - 0.5, -0.7))
            axes.set_yticks(range(len(methods)), [method.name for method in methods])
            axes.tick_params(axis="y", length=0)
            axes.grid(axis="x")
            round_ticks_inside(axes, margin=0.14)
        note(figure, "\n".join(lines))

    scored = max(
        (entry.n for entry in evaluation.summary if (entry.case, entry.score) == (case, "ssim_whole")), default=0
    )
    title = f"Views against {scored} photographs"
    return write_chart(data, draw, (11.6, 2.9 + 0.62 * len(methods) + 0.17 * len(lines)), title=title)


def _case_chart(evaluation: Evaluation, names: Sequence[str], data: Path) -> Path:
    """One panel for each score, one row for each case, one marker for each method."""
    peers = [method.name for method in evaluation.ran if method.peer]
    markers = ("o", "s", "D", "v", "P", "X", "*", "h", "<", ">")

    def draw(figure: Any) -> None:
        panels = figure.subplots(1, len(CASE_PANELS), sharey=True)
        for axes, score in zip(panels, CASE_PANELS, strict=True):
            for row, case in enumerate(names):
                bound = evaluation.bound_of(case, score)
                if bound is not None and not math.isnan(bound.mean):
                    label = "limit, modelled" if row == 0 else None
                    axes.plot(bound.mean, row, "|", color=TEXT, markersize=16, markeredgewidth=1.6, label=label)
            for number, method in enumerate(evaluation.ran):
                means = [evaluation.mean(case, method.name, score) for case in names]
                points = [(m.mean, row) for row, m in enumerate(means) if math.isfinite(m.mean)]
                if not points:
                    continue
                look = (
                    {"color": WARNING, "marker": "^<>"[peers.index(method.name) % 3], "zorder": 3}
                    if method.peer
                    else {
                        "marker": markers[number % len(markers)],
                        "facecolor": "none",
                        "edgecolor": OURS,
                    }
                )
                axes.scatter(*zip(*points, strict=True), s=42, label=method.name, **look)
            axes.set_title(PANELS[score])
            axes.set(ylim=(len(names) - 0.5, -0.5))
            axes.set_yticks(range(len(names)), [_case_label(evaluation, case) for case in names])
            axes.tick_params(axis="y", length=0)
            axes.grid()
            round_ticks_inside(axes, margin=0.08)
        handles, labels = panels[0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside lower left", ncols=4, fontsize=9.5)

    return write_chart(data, draw, (11.6, 2.4 + 0.42 * len(names)), title="Every case")


def _case_label(evaluation: Evaluation, case: str) -> str:
    """The case's name, and how much of the surface in its views the frame saw."""
    for method in evaluation.ran:
        surface, observed = (evaluation.mean(case, method.name, name) for name in ("surface_px", "observed_px"))
        if surface.mean > 0:
            return f"{case} ({observed.mean / surface.mean:.0%} observed)"
    return case


def _explanations(evaluation: Evaluation, case: str) -> list[str]:
    bound = evaluation.bound_of(case, "ssim_whole")
    lines = ["mean and 95 % confidence interval; stroke: worst photograph; round: ours, triangle: the paper's method"]
    if bound is not None:
        lines.append(
            f"dashed, modelled: a perfect view with the same noise, exposure and poses off by {bound.jitter_px:.1f} px"
        )
    title = "All cases" if case == ALL else case
    reasons = [text for text in where_peers_lead(evaluation) if text.startswith(f"{title}: ")]
    lines += [line for text in reasons for line in textwrap.wrap(text, LINE_LETTERS)]
    return [*lines, evaluation.conditions.short()]
