"""The record of a pose from landmarks and image, for the case file."""

from collections.abc import Mapping

from ..landmarks.align_landmarks import LANDMARKS, Alignment
from ..landmarks.report import alignment_record, pairs_record
from .evidence import PoseEvidence


def joined_record(
    refinement: Mapping[str, object], image: PoseEvidence, found: Alignment, tool: str, date: str
) -> dict[str, object]:
    """The record for a case file: see :mod:`oneframe.case.alignment_record`. The same in any frame of the surface.

    Parameters
    ----------
    refinement
        Its record.
    image, found
        The refined pose, and the pose from all evidence, in one frame.
    tool, date
        Program and version; day in ISO 8601.
    """
    if image.kind not in found.kinds:
        return alignment_record(found, tool, date)
    if LANDMARKS not in found.kinds:
        return dict(refinement)
    estimate = found.estimate
    record = {**refinement, "evidence": ", ".join(found.kinds), "tool": tool, "date": date}
    if isinstance(error_px := refinement.get("error_px"), float):
        # surer than the image alone by as much as a ball around the pivot is
        surer = estimate.uncertainty.spread_px(found.camera, estimate.cam_from_model)
        record["error_px"] = error_px * surer / image.uncertainty.spread_px(found.camera, image.cam_from_model)
    return {**record, **pairs_record(found), **estimate.uncertainty.record()}
