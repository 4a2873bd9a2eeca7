"""Sentences about an evaluation: what was skipped or missing, and where the paper's method is ahead, and why."""

import math
from collections.abc import Iterator, Sequence

from .evaluation_record import ALL, Evaluation

CLEARLY_BLURRED = 0.8
"""Sharpness relative to that of the method it is compared with, below which a view counts as blurred."""
RANKED = {
    "ssim_whole": "SSIM of the whole image",
    "ssim_surface": "SSIM inside the surface",
    "ssim_observed": "SSIM inside the observed surface",
}


def evaluation_notes(evaluation: Evaluation, without_overlap: Sequence[tuple[str, str]] = ()) -> list[str]:
    """The notes, in the order of their importance."""
    notes = [f"{method.name}: skipped, {method.skipped}." for method in evaluation.methods if method.skipped]
    if evaluation.missing:
        notes.append(evaluation.missing)
    if any(entry.fid_biased for entry in evaluation.distribution):
        notes.append("FID is biased: it needs 2048 images or more. Compare KID.")
    notes += [f"{case}: {image} shows nothing of the surface and has no scores." for case, image in without_overlap]
    return [*notes, *where_peers_lead(evaluation)]


def where_peers_lead(evaluation: Evaluation) -> Iterator[str]:
    """A sentence for every case and score by which the paper's method is ahead of all of ours, with the cause."""
    peers = [method.name for method in evaluation.ran if method.peer]
    ours = [method.name for method in evaluation.ran if not method.peer]
    names = [case.name for case in evaluation.cases]
    for case in [*names, *[ALL] * (len(names) > 1)]:
        for score, text in RANKED.items():
            leader, best = (_best(evaluation, case, methods, score) for methods in (peers, ours))
            if leader is None or best is None or leader[1] <= best[1]:
                continue
            title = "All cases" if case == ALL else case
            yield (
                f"{title}: {leader[0]} is ahead in {text}, {leader[1]:.3f} against {best[1]:.3f} ({best[0]}); "
                f"{_cause(evaluation, case, leader[0], best[0], score)}"
            )


def _cause(evaluation: Evaluation, case: str, leader: str, best: str, score: str) -> str:
    parts = []
    surface, observed = (evaluation.mean(case, best, name).mean for name in ("surface_px", "observed_px"))
    if score != "ssim_observed" and surface > 0:
        seen = observed / surface
        parts.append(
            f"the frame saw {seen:.0%} of the surface in view: we show the rest in grey, the other paints it too, with "
            "colours of whatever lies in front of it"
        )
    sharpness = [evaluation.mean(case, method, "sharpness").mean for method in (leader, best)]
    if sharpness[0] < CLEARLY_BLURRED * sharpness[1]:
        flow = evaluation.mean(case, best, "flow_px").mean
        parts.append(
            f"its sharpness is {sharpness[0]:.2f} of the photograph's, ours {sharpness[1]:.2f}: with views "
            f"displaced by {flow:.1f} px blur raises SSIM"
        )
    aligned = [evaluation.mean(case, method, "ssim_aligned").mean for method in (leader, best)]
    if not any(map(math.isnan, aligned)):
        parts.append(f"inside the observed surface, aligned, it is {aligned[0]:.3f} against {aligned[1]:.3f}")
    return "; ".join(parts) + "."


def _best(evaluation: Evaluation, case: str, methods: Sequence[str], score: str) -> tuple[str, float] | None:
    found = [(method, evaluation.mean(case, method, score).mean) for method in methods]
    return max((each for each in found if not math.isnan(each[1])), key=lambda each: each[1], default=None)
