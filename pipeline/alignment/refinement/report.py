"""Reports of a refined pose: a table for a program, a record for the case file."""

from collections.abc import Mapping

import numpy as np

from ...transforms import inverse_rigid
from .verdict import Refinement

KEPT_OF_START = ("method", "pairs", "rms_px")
"""What the record of a refined pose keeps of the record of its initial pose, as ``start_...``."""


def refinement_record(refinement: Refinement, start: Mapping[str, object], tool: str, date: str) -> dict[str, object]:
    """The record for a case file: see :mod:`oneframe.case.alignment_record`. The same in any frame of the surface.

    Parameters
    ----------
    refinement
        Accepted, or refused and taken all the same.
    start
        The record of the initial pose.
    tool, date
        Program and version; day in ISO 8601.
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
        "evidence": "image",
        "tool": tool,
        "date": date,
        **({} if refinement.accepted else {"refused": refinement.objection}),
        **start,
        **{key: float(value) for key, value in numbers.items() if np.isfinite(value)},
        **({} if uncertainty is None else uncertainty.record()),
    }


def refinement_table(refinement: Refinement, mesh_from_model: np.ndarray, *, taken: bool) -> dict[str, object]:
    """Table for JSON: lengths in mm, angles in degrees, ``None`` where a number is unknown.

    Parameters
    ----------
    refinement
        In the frame ``model``.
    mesh_from_model
        ``(4, 4)``; the table is for the frame of the mesh file.
    taken
        Whether the pose is the refined one although that was refused.
    """
    cam_from_mesh = refinement.found @ inverse_rigid(mesh_from_model)
    uncertainty, tests = refinement.uncertainty if refinement.verified else None, refinement.verification
    return {
        "accepted": refinement.accepted,
        "taken_although_refused": taken,
        "message": refinement.message,
        "found_cam_from_mesh": cam_from_mesh.tolist(),
        "moved_px": _known(refinement.moved_px),
        "moved_deg": _known(refinement.rotation_deg),
        "before": {"explained": refinement.before.score, "error_px": _known(refinement.before.error_px)},
        "after": {
            "explained": refinement.after.score,
            "error_px": _known(refinement.after.error_px),
            "error_is_lower_bound": not refinement.verified,
        },
        "split_half_px": None if tests is None else _known(tests.split_half_px),
        "second_peak_ratio": None if tests is None else _known(tests.second_peak_ratio),
        "uncertainty": None if uncertainty is None else uncertainty.table(mesh_from_model),
    }


def _known(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None
