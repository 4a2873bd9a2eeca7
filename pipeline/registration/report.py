"""The record of a registered pose, for the case file of its frame."""

from collections.abc import Mapping

import numpy as np

from ..camera.pinhole import PinholeCamera
from ..case.alignment_record import REGISTERED
from .register import RegisteredFrame
from .verdict import ACCEPTED


def registration_record(
    found: RegisteredFrame,
    camera: PinholeCamera,
    mesh_from_model: np.ndarray,
    source: Mapping[str, object],
    source_name: str,
    tool: str,
    date: str,
) -> dict[str, object]:
    """See :mod:`oneframe.case.alignment_record`; nothing if the frame is refused.

    Parameters
    ----------
    found
        The frame.
    camera
        Of the frame at its full size.
    mesh_from_model
        ``(4, 4)``, mm.
    source, source_name
        The record of the aligned frame's pose, and the name of its file.
    tool, date
        Program and version; day in ISO 8601.
    """
    if found.cam_from_model is None or found.uncertainty is None:
        return {}
    # nobody knows how far it is off where the aligned frame's pose says nothing
    is_known = "standard_deviation_mm" in source
    return {
        "method": REGISTERED,
        "tool": tool,
        "date": date,
        **({} if found.verdict.state == ACCEPTED else {"doubt": found.verdict.reason}),
        "probability": found.verdict.probability,
        "start_frame": source_name,
        **({"start_method": source["method"]} if "method" in source else {}),
        **({"error_px": found.uncertainty.spread_px(camera, found.cam_from_model)} if is_known else {}),
        **found.uncertainty.record(),
        **found.uncertainty.entry(mesh_from_model),
    }
