"""The uncertainty of the case, of its surface and of the aligned frame's own pose, in the poses that are registered."""

from dataclasses import replace

import numpy as np

from ..alignment.pose_uncertainty import PoseUncertainty
from ..camera.pinhole import PinholeCamera
from ..files.numbers import format_two_digits
from ..transforms import camera_centre
from .register import RegisteredFrame
from .verdict import ACCEPTED, DOUBTFUL, LEAST_ACCEPTED, within

SURFACE_SHARE = 1 / 3000
"""Standard deviation of the surface's depth as a whole, seen from the aligned frame, relative to the distance: 0.1 mm
at 300 mm. Two surfaces from CT with voxels of 0.4 mm were 0.05 and 0.1 mm off; half or twice as much covers as many."""


def with_case(
    found: RegisteredFrame, source: PoseUncertainty | None, source_from_model: np.ndarray, camera: PinholeCamera
) -> RegisteredFrame:
    """A registered frame whose covariance, probability and state include what surface and aligned frame are off.

    To first order, what the aligned frame shows moves with its pose as a whole, and takes the others along; but not
    where it is too far for a lens that is too long, as then is every frame, along its own axis. A surface
    that is too deep along its rays is one scaled about its centre: so is then the way from there to another frame.

    Parameters
    ----------
    found
        Registered to the aligned frame.
    source
        Uncertainty of its pose, about the same pivot; ``None`` if nobody states it.
    source_from_model
        ``(4, 4)`` that pose, mm.
    camera
        Of the frames.
    """
    pose, own = found.cam_from_model, found.uncertainty
    if pose is None or own is None:
        return found
    way = np.append(pose[:3, :3] @ (camera_centre(pose) - camera_centre(source_from_model)), np.zeros(3))
    uncertainty = replace(own, covariance=own.covariance + SURFACE_SHARE**2 * np.outer(way, way))
    if source is not None:
        turn = np.kron(np.eye(2), pose[:3, :3] @ source_from_model[:3, :3].T)
        covariance = uncertainty.covariance + turn @ source.at_focal_length.covariance @ turn.T
        farther = float(own.pivot_cam[2] / source.pivot_cam[2])
        uncertainty = replace(own, covariance=covariance).with_focal_depth(farther * source.focal_depth_mm)
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
