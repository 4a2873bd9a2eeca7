"""The record of a pose for the case file: from landmarks, from the image, or from both; the same in any frame.

Its keys are those of :mod:`oneframe.case.alignment_record`.
"""

from collections.abc import Mapping
from dataclasses import astuple
from typing import Any

import numpy as np

from ..camera.pinhole import PinholeCamera
from ..transforms import transform_points
from .landmarks.align_landmarks import LANDMARKS, Alignment
from .pose_uncertainty import PoseEvidence, PoseUncertainty
from .posterior.solve import IMAGE
from .refinement.verdict import Refinement

_OF_THE_POSE = ("image", "checked", "pairs", "rms_px", "click_sigma_px")
"""Keys of a record that hold for its pose, and for none that landmarks and image give later."""

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
        "evidence": "image",
        "tool": tool,
        "date": date,
        **({} if refinement.accepted else {"refused": refinement.objection}),
        **start,
        **{key: float(value) for key, value in numbers.items() if np.isfinite(value)},
        **({} if uncertainty is None else uncertainty.record()),
    }


def joined_record(
    refinement: Mapping[str, object], image: PoseEvidence, found: Alignment, tool: str, date: str
) -> dict[str, object]:
    """The record of a pose from a refinement and landmarks, or from whichever of them takes part.

    ``image`` is the refined pose, ``found`` that of all evidence, in one frame; ``date`` is a day in ISO 8601.
    """
    if IMAGE not in found.kinds:
        return alignment_record(found, tool, date)
    if LANDMARKS not in found.kinds:
        return dict(refinement)
    estimate = found.estimate
    record = {**refinement, "evidence": ", ".join(found.kinds), "tool": tool, "date": date}
    if isinstance(error_px := refinement.get("error_px"), float):
        # surer than the image alone by as much as a ball around the pivot is
        surer = estimate.uncertainty.spread_px(found.camera, estimate.cam_from_model)
        record["error_px"] = error_px * surer / image.uncertainty.spread_px(found.camera, image.cam_from_model)
    return {**record, **_pairs(found), **estimate.uncertainty.record()}


def image_table(image: PoseEvidence, camera: PinholeCamera, refinement: Mapping[str, object]) -> dict[str, object]:
    """What a case file keeps of the image's evidence, in the frame of the mesh; ``refinement`` is its record."""
    known = image.uncertainty
    return {
        "camera": list(astuple(camera)),
        "cam_from_mesh": image.cam_from_model.tolist(),
        "covariance": known.covariance.tolist(),
        "pivot_mm": known.pivot_model.tolist(),
        "radius_mm": known.radius_mm,
        "degrees_of_freedom": known.dof,
        "error_px": refinement.get("error_px", 0.0),
    }


def image_evidence_of(
    record: Mapping[str, Any], camera: PinholeCamera
) -> tuple[PoseEvidence, dict[str, object]] | None:
    """The image's evidence in a case's record, in the frame of the mesh, and the record of its refinement alone.

    ``None`` without any, or if it was found with another K.
    """
    table = record.get("image")
    if table is None or table["camera"] != list(map(float, astuple(camera))):
        return None
    pose, pivot = np.array(table["cam_from_mesh"]), np.array(table["pivot_mm"])
    uncertainty = PoseUncertainty(
        pivot_model=pivot,
        covariance=np.array(table["covariance"]),
        dof=table["degrees_of_freedom"],
        sigma_px=np.nan,
        radius_mm=table["radius_mm"],
        pivot_cam=transform_points(pose, pivot),
    )
    own = {key: value for key, value in record.items() if key not in _OF_THE_POSE}
    own |= {"evidence": IMAGE, "error_px": table["error_px"], **uncertainty.record()}
    return PoseEvidence(pose, uncertainty), own


def _pairs(alignment: Alignment) -> dict[str, object]:
    """What the record of a pose keeps of its landmarks."""
    estimate = alignment.estimate
    return {
        "pairs": int(estimate.inliers.sum()),
        "rms_px": estimate.rms_px,
        "click_sigma_px": alignment.click_sigma_px,
    }
