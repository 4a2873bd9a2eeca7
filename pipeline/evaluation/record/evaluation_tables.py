"""Tables of an evaluation: every frame as CSV, the means as Markdown and as LaTeX.

Beside them sentences: what was skipped or missing, and where the paper's method is ahead.
"""

import math
from collections.abc import Iterator, Mapping, Sequence

from ..scores.view_scores import SCORES
from .evaluation_record import ALL, AngleSummary, Evaluation, Summary

FRAME_COLUMNS = ("case", "image", "method", *SCORES)
MARKDOWN_HEAD, LATEX_HEAD = "# Evaluation", "% Evaluation by OneFrame"

TABLES: dict[str, dict[str, tuple[str, int]]] = {
    "As in the paper": {
        "ssim_whole": ("SSIM, whole image", 3),
        "ssim_surface": ("SSIM, surface", 3),
        "ssim_observed": ("SSIM, observed", 3),
        "psnr_whole": ("PSNR, whole (dB)", 1),
        "psnr_observed": ("PSNR, observed (dB)", 1),
        "error_observed": ("error, observed (/255)", 1),
    },
    "After correction of exposure and colour": {
        "ssim_whole_corrected": ("SSIM, whole image", 3),
        "ssim_surface_corrected": ("SSIM, surface", 3),
        "ssim_observed_corrected": ("SSIM, observed", 3),
        "psnr_observed_corrected": ("PSNR, observed (dB)", 1),
        "error_observed_corrected": ("error, observed (/255)", 1),
        "ssim_aligned": ("SSIM, observed, aligned", 3),
    },
    "Registration and edges": {
        "flow_px": ("displacement (px)", 2),
        "correlation_observed": ("correlation", 3),
        "gradient_correlation": ("gradients' cosine", 3),
        "edge_f": ("F-score of edges", 3),
        "edge_px": ("edge distance (px)", 2),
        "sharpness": ("sharpness", 2),
    },
}
"""Tables of the summary -> their scores -> heading and decimals."""
LATEX_SCORES = {
    "ssim_whole": ("SSIM whole", 3),
    "ssim_surface": ("SSIM surface", 3),
    "ssim_observed": ("SSIM observed", 3),
    "psnr_whole": ("PSNR whole", 1),
    "ssim_aligned": ("SSIM aligned", 3),
    "edge_f": ("edge F", 3),
}
SPECIAL = {letter: f"\\{letter}" for letter in "&%_#${}"}
SPECIAL |= {"~": r"\textasciitilde{}", "^": r"\textasciicircum{}", "\\": r"\textbackslash{}"}

FILLED, MOST_OBSERVED = ", fill, ", 0.98
"""In the name of a method, and the share of the surface that is as good as all."""
RANKED = {
    "ssim_whole": "SSIM of the whole image",
    "ssim_surface": "SSIM inside the surface",
    "ssim_observed": "SSIM inside the observed surface",
}


def frame_rows(evaluation: Evaluation) -> list[tuple[object, ...]]:
    """The rows of frames.csv; scores that a view does not have are empty."""
    return [
        (row.case, row.image, row.method, *("" if math.isnan(row.scores[s]) else row.scores[s] for s in SCORES))
        for row in evaluation.rows
    ]


def markdown_summary(evaluation: Evaluation, notes: Sequence[str]) -> bytes:
    """The summary as Markdown: what was skipped and found, then a block of tables for each case."""
    lines = [f"{MARKDOWN_HEAD}", ""]
    lines += [f"{line}  " for line in evaluation.conditions.lines()]
    lines += [
        "",
        "Means with 95 % confidence intervals: bootstrap over surfaces, then cases, then photographs.",
        "The limit is modelled: what a perfect view would score with the same noise, exposure and error of the pose.",
        "",
    ]
    lines += [f"- {note}" for note in notes]
    for case in _cases(evaluation):
        bound = evaluation.bound_of(case, "ssim_whole")
        title = "All cases" if case == ALL else case
        lines += ["", f"## {title}", ""]
        if bound is not None:
            lines += [f"Limit: poses off by {bound.jitter_px:.2f} px.", ""]
        for name, scores in TABLES.items():
            headings = [heading for heading, _ in scores.values()]
            lines += [f"**{name}**", "", _line("", *headings), "|---" * (len(scores) + 1) + "|"]
            for method in evaluation.ran:
                found = [evaluation.mean(case, method.name, score) for score in scores]
                lines.append(_line(method.name, *map(_interval, found, _decimals(scores))))
            lines += [_line("*limit, modelled*", *_limits(evaluation, case, scores)), ""]
        lines += ["**Worst photograph**", "", _line("", *(heading for heading, _ in LATEX_SCORES.values()))]
        lines += ["|---" * (len(LATEX_SCORES) + 1) + "|"]
        for method in evaluation.ran:
            worst = [evaluation.mean(case, method.name, score).worst for score in LATEX_SCORES]
            lines.append(_line(method.name, *map(_number, worst, _decimals(LATEX_SCORES))))
        lines += ["", *_angle_lines(evaluation, case)]
        lines += _distribution_lines(evaluation, case)
    return ("\n".join(lines).rstrip() + "\n").encode()


def latex_summary(evaluation: Evaluation) -> bytes:
    """The summary as LaTeX with booktabs: a table for each case, the best of each score in bold."""
    lines = [LATEX_HEAD, "% \\usepackage{booktabs}"]
    lines += [f"% {_escaped(line)}" for line in evaluation.conditions.lines()]
    for case in _cases(evaluation):
        with_distribution = any(entry.case == case for entry in evaluation.distribution)
        headings = [heading for heading, _ in LATEX_SCORES.values()] + ["FID", "KID"] * with_distribution
        name = "All cases" if case == ALL else _escaped(case)
        n = max((entry.n for entry in evaluation.summary if entry.case == case), default=0)
        lines += [
            "", r"\begin{table}", r"\centering",
            rf"\caption{{{name}: mean $\pm$ half of the 95\,\% confidence interval, {n} photographs.}}",
            rf"\begin{{tabular}}{{l{'c' * len(headings)}}}", r"\toprule",
            " & ".join(["", *headings]) + r" \\", r"\midrule",
        ]  # fmt: skip
        for method in evaluation.ran:
            cells = [_escaped(method.name)]
            found = [evaluation.mean(case, method.name, score) for score in LATEX_SCORES]
            for each, decimals in zip(found, _decimals(LATEX_SCORES), strict=True):
                cells.append(_latex_cell(each, decimals))
            if with_distribution:
                cells += _latex_distribution(evaluation, case, method.name)
            lines.append(" & ".join(cells) + r" \\")
        limits = _limits(evaluation, case, LATEX_SCORES)
        if any(limits):
            lines += [r"\midrule", " & ".join(["limit, modelled", *limits, *[""] * (2 * with_distribution)]) + r" \\"]
        lines += [r"\bottomrule", r"\end{tabular}", r"\end{table}"]
    return ("\n".join(lines) + "\n").encode()


def _cases(evaluation: Evaluation) -> list[str]:
    names = [case.name for case in evaluation.cases]
    return [*names, ALL] if len(names) > 1 else names


def _distribution_lines(evaluation: Evaluation, case: str) -> list[str]:
    entries = [entry for entry in evaluation.distribution if entry.case == case]
    if not entries:
        return []
    few = any(entry.fid_biased for entry in entries)
    headings = _line("", f"FID{' (biased: few images)' * few}", "KID", "photographs")
    cells = [(e.method, f"{e.fid:.1f}", f"{e.kid:.4f} ± {e.kid_standard_error:.4f}", f"{e.n}") for e in entries]
    return ["**Distributions**", "", headings, "|---|---|---|---|", *(_line(*each) for each in cells), ""]


def _angle_lines(evaluation: Evaluation, case: str) -> list[str]:
    entries = {(e.method, e.score, e.from_deg): e for e in evaluation.angles if e.case == case}
    if not entries:
        return []
    columns = {(e.score, e.from_deg): e for e in sorted(entries.values(), key=lambda e: (e.score, e.from_deg))}
    headings = [
        f"{score.partition('_')[2]}, {each.from_deg:g} to {each.to_deg:g}° ({each.n})"
        for (score, _), each in columns.items()
    ]
    lines = ["**Error (/255) by the angle from the nearest frame** (photographs)", "", _line("", *headings)]
    lines.append("|---" * (len(columns) + 1) + "|")
    for method in evaluation.ran:
        found = [entries.get((method.name, *column)) for column in columns]
        lines.append(_line(method.name, *("" if each is None else _interval(each, 1) for each in found)))
    return [*lines, ""]


def _line(*cells: str) -> str:
    return f"| {' | '.join(cells)} |"


def _decimals(scores: Mapping[str, tuple[str, int]]) -> list[int]:
    return [decimals for _, decimals in scores.values()]


def _limits(evaluation: Evaluation, case: str, scores: Mapping[str, tuple[str, int]]) -> list[str]:
    found = [evaluation.bound_of(case, score) for score in scores]
    return ["" if each is None else _number(each.mean, d) for each, d in zip(found, _decimals(scores), strict=True)]


def _interval(found: Summary | AngleSummary, decimals: int) -> str:
    if math.isnan(found.low):
        return _number(found.mean, decimals)
    return f"{found.mean:.{decimals}f} [{found.low:.{decimals}f}, {found.high:.{decimals}f}]"


def _latex_cell(found: Summary, decimals: int) -> str:
    if not math.isfinite(found.mean):
        return "--"
    text = f"{found.mean:.{decimals}f}"
    text = rf"\mathbf{{{text}}}" if found.best else text
    return f"${text}$" if math.isnan(found.low) else rf"${text} \pm {(found.high - found.low) / 2:.{decimals}f}$"


def _latex_distribution(evaluation: Evaluation, case: str, method: str) -> list[str]:
    for entry in evaluation.distribution:
        if (entry.case, entry.method) == (case, method):
            return [f"${entry.fid:.1f}$", rf"${entry.kid:.4f} \pm {entry.kid_standard_error:.4f}$"]
    return ["--", "--"]


def _number(value: float, decimals: int) -> str:
    return "" if math.isnan(value) else f"{value:.{decimals}f}"


def _escaped(text: str) -> str:
    return "".join(SPECIAL.get(letter, letter) for letter in text)


def evaluation_notes(evaluation: Evaluation, without_overlap: Sequence[tuple[str, str]] = ()) -> list[str]:
    """The notes, in the order of their importance."""
    notes = [f"{method.name}: skipped, {method.skipped}." for method in evaluation.methods if method.skipped]
    if evaluation.missing:
        notes.append(evaluation.missing)
    if any(entry.fid_biased for entry in evaluation.distribution):
        notes.append("FID is biased: it needs 2048 images or more. Compare KID.")
    if evaluation.seconds:
        took, prepared = (evaluation.seconds[name] for name in ("all", "preparation"))
        notes.append(
            f"It took {took:.0f} s; {prepared:.0f} s of them prepared surfaces and methods before a first view."
        )
    notes += [f"{case}: {image} shows nothing of the surface and has no scores." for case, image in without_overlap]
    return [*notes, *which_unseen(evaluation), *where_peers_lead(evaluation)]


def which_unseen(evaluation: Evaluation) -> Iterator[str]:
    """Which ``--unseen`` serves which aim, where the frame did not see all of the surface in view."""
    case = ALL if len(evaluation.cases) > 1 else evaluation.cases[0].name
    neutral = next((method.name for method in evaluation.ran if not (method.peer or FILLED in method.name)), None)
    if neutral is None:
        return
    surface, observed = (evaluation.mean(case, neutral, name).mean for name in ("surface_px", "observed_px"))
    if not observed < MOST_OBSERVED * surface:
        return
    head, _, engine = neutral.rpartition(", ")
    found = [evaluation.mean(case, name, "ssim_surface") for name in (f"{head}{FILLED}{engine}", neutral)]
    figures = f" (SSIM {found[0].mean:.3f} against {found[1].mean:.3f})" if found[0].n and found[1].n else ""
    yield (
        f"The frame saw {observed / surface:.0%} of the surface in view. Where all of it is to look like photographs, "
        f"render with --unseen fill{figures}. --unseen neutral paints nothing that the frame did not show: its grey "
        "counts as wrong on the whole surface, so judge it by the observed one."
    )


def where_peers_lead(evaluation: Evaluation) -> Iterator[str]:
    """A sentence for every case and score by which the paper's method is ahead of all of ours.

    Ahead is what the interval of the paired difference tells apart.
    """
    names = [case.name for case in evaluation.cases]
    for case in [*names, *[ALL] * (len(names) > 1)]:
        for score, text in RANKED.items():
            found = [evaluation.mean(case, method.name, score) for method in evaluation.ran]
            peers, ours = (
                [each for each, method in zip(found, evaluation.ran, strict=True) if method.peer == peer and each.n]
                for peer in (True, False)
            )
            if not peers or not ours:
                continue
            leader, best = (max(group, key=lambda each: each.mean) for group in (peers, ours))
            if leader.mean > best.mean and best.behind_low > 0:
                title = "All cases" if case == ALL else case
                yield (
                    f"{title}: {leader.method} is ahead in {text}, {leader.mean:.3f} against {best.mean:.3f} "
                    f"({best.method}), by {best.behind_low:.3f} to {best.behind_high:.3f} on the same photographs."
                )
