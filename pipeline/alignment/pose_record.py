"""The record of a pose for the case file: from landmarks or from the image; the same in any frame.

Its keys are those of :mod:`oneframe.case.alignment_record`.
"""

from collections.abc import Mapping

import numpy as np

from .landmarks.align_landmarks import Alignment
from .refinement.verdict import Refinement

KEPT_OF_START = ("method", "pairs", "rms_px")
"""What the record of a refined pose keeps of the record of its initial pose, as ``start_...``."""


def alignment_record(alignment: Alignment, tool: str, date: str) -> dict[str, object]:
    """The record of a pose from landmarks alone; day in ISO 8601."""
    found = {"method": "landmarks", "tool": tool, "date": date}
    return {**found, **_pairs(alignment), **alignment.estimate.uncertainty.record()}


def refinement_record(refinement: Refinement, start: Mapping[str, object], tool: str, date: str) -> dict[str, object]:
    """The record of a pose that was refined against the image.

    ``start`` is the record of the initial pose, ``date`` a day in ISO 8601.
    """
    start = {f"start_{key}": start[key] for key in KEPT_OF_START if key in start}
    # a pose that failed the verification may be anywhere: standard deviations would promise too much
    uncertainty = refinement.uncertainty if refinement.verified else None
    numbers: dict[str, float] = {
        "error_px": refinement.after.error_px,
        "start_error_px": refinement.before.error_px,
        "explained": refinement.after.score,
        "start_explained": refinement.before.score,
        "moved_px": refinement.moved_px,
        "moved_deg": refinement.rotation_deg,
    }
    if refinement.verification is not None:
        numbers["split_half_px"] = refinement.verification.split_half_px
        numbers["second_peak_ratio"] = refinement.verification.second_peak_ratio
    return {
        "method": "refined",
        "tool": tool,
        "date": date,
        **({} if refinement.accepted else {"refused": refinement.objection}),
        **start,
        **{key: float(value) for key, value in numbers.items() if np.isfinite(value)},
        **({} if uncertainty is None else uncertainty.record()),
    }


def _pairs(alignment: Alignment) -> dict[str, object]:
    """What the record of a pose keeps of its landmarks."""
    estimate = alignment.estimate
    return {
        "pairs": int(estimate.inliers.sum()),
        "rms_px": estimate.rms_px,
        "click_sigma_px": alignment.click_sigma_px,
    }
