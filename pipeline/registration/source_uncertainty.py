"""The uncertainty of the aligned frame's own pose, in the poses that are registered to it."""

from dataclasses import replace

import numpy as np

from ..alignment.pose_uncertainty import PoseUncertainty
from ..camera.pinhole import PinholeCamera
from ..files.numbers import format_two_digits
from .register import RegisteredFrame
from .verdict import ACCEPTED, DOUBTFUL, LEAST_ACCEPTED, within


def with_source(
    found: RegisteredFrame, source: PoseUncertainty, source_from_model: np.ndarray, camera: PinholeCamera
) -> RegisteredFrame:
    """A registered frame whose covariance, probability and state include what the aligned frame's pose is off.

    To first order, what that frame shows moves with its pose as a whole, and takes the others along.

    Parameters
    ----------
    found
        Registered to the aligned frame.
    source
        Uncertainty of its pose, about the same pivot.
    source_from_model
        ``(4, 4)`` that pose, mm.
    camera
        Of the frames.
    """
    pose, own = found.cam_from_model, found.uncertainty
    if pose is None or own is None:
        return found
    turn = np.kron(np.eye(2), pose[:3, :3] @ source_from_model[:3, :3].T)
    uncertainty = replace(own, covariance=own.covariance + turn @ source.covariance @ turn.T)
    alone, both = within(own, camera), within(uncertainty, camera)
    verdict = replace(found.verdict, probability=found.verdict.probability * min(both / max(alone, 1e-9), 1.0))
    if verdict.state == ACCEPTED and verdict.probability < LEAST_ACCEPTED:
        verdict = replace(verdict, state=DOUBTFUL, reason=f"{verdict.reason}, but the aligned frame's pose is not sure")
    return replace(found, verdict=verdict, uncertainty=uncertainty)


def doubt_of_source(source: PoseUncertainty, camera: PinholeCamera) -> str:
    """A sentence if no frame can be accepted, so unsure is the aligned frame's pose; empty otherwise."""
    probability = within(source, camera)
    if probability >= LEAST_ACCEPTED:
        return ""
    return (
        f"the case's own pose is within the limits of an accepted one with {probability:.0%} only: ±"
        f"{format_two_digits(source.largest_rotation_deg)}°, least certain: {source.weakest}; no frame can be surer; "
        "refine it, or add --correct-source"
    )
