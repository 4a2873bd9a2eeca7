"""Registered frames as a film and a page show them: how sure each pose is, and what to look at first."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ..alignment.pose_uncertainty import PoseUncertainty
from ..camera.pinhole import PinholeCamera
from ..colour.source_view import SourceView
from ..surface.mesh import TriangleMesh
from ..transforms import transform_points
from .register import RegisteredFrame
from .verdict import ACCEPTED, DOUBTFUL, REFUSED, WITHIN_PX, Verdict

COLOURS = {ACCEPTED: (70, 180, 90), DOUBTFUL: (230, 180, 40), REFUSED: (210, 60, 50)}
"""State of a frame -> its colour in pictures, sRGB."""
FAINTEST = 0.25
"""Opacity of an overlay that is least sure, relative to a sure one."""


@dataclass(frozen=True)
class FrameEvidence:
    """What is known of a frame.

    Attributes
    ----------
    number
        Counted from 0, in the video or among the images.
    verdict
        State, probability and reason.
    cam_from_model
        ``(4, 4)``, mm; ``None`` if the frame is refused.
    rotation_deg, position_mm
        Standard deviations of the pose, about and along its least certain axis.
    image_px
        Root mean square displacement of what is drawn, in the image that was registered.
    picture
        The frame with the overlay as WebP; ``None`` if none was kept.
    """

    number: int
    verdict: Verdict
    cam_from_model: np.ndarray | None
    rotation_deg: float = np.nan
    position_mm: float = np.nan
    image_px: float = np.nan
    picture: bytes | None = None

    @property
    def opacity(self) -> float:
        """Of the overlay, 0..1: the less sure the fainter, none without a pose."""
        if self.cam_from_model is None:
            return 0.0
        return max(FAINTEST, self.verdict.probability * (1 - 2 * self.image_px / WITHIN_PX))

    @property
    def words(self) -> str:
        """State and reason."""
        return f"{self.verdict.state}: {self.verdict.reason}"


@dataclass(frozen=True)
class RegistrationEvidence:
    """What was found in all frames.

    Attributes
    ----------
    frames
        In their order.
    mesh, source
        The surface in the model frame, and the case's frame, at the size at which frames are registered.
    pivot_model
        ``(3,)``, mm: the surface point in the middle of the case's frame.
    alignment
        The record of the case's pose.
    is_film
        Whether the frames follow each other.
    """

    frames: tuple[FrameEvidence, ...]
    mesh: TriangleMesh
    source: SourceView
    pivot_model: np.ndarray
    alignment: Mapping[str, object]
    is_film: bool


def frame_evidence(
    number: int, found: RegisteredFrame, camera: PinholeCamera, points_model: np.ndarray, picture: bytes | None = None
) -> FrameEvidence:
    """What is known of a frame of a camera; ``points_model`` ``(N, 3)`` stand for what is drawn over it."""
    if found.cam_from_model is None or found.covariance is None:
        return FrameEvidence(number, found.verdict, None, picture=picture)
    pose, pivot = found.cam_from_model, found.pivot_model
    uncertainty = PoseUncertainty(
        pivot, found.covariance, np.inf, np.nan, radius_mm=np.nan, pivot_cam=transform_points(pose, pivot[None])[0]
    )
    spread = uncertainty.pixel_covariances(points_model, camera, pose)
    return FrameEvidence(
        number,
        found.verdict,
        pose,
        uncertainty.largest_rotation_deg,
        float(np.sqrt(np.linalg.eigvalsh(found.covariance[:3, :3])[-1])),
        float(np.sqrt(np.trace(spread, axis1=1, axis2=2).mean())),
        picture,
    )


def stretches(frames: Sequence[FrameEvidence]) -> list[tuple[int, int]]:
    """Where the state stays the same: places of the first and of the last frame of each stretch."""
    starts = [at for at, frame in enumerate(frames) if at == 0 or frame.verdict.state != frames[at - 1].verdict.state]
    return list(zip(starts, [*(at - 1 for at in starts[1:]), len(frames) - 1], strict=True))


def worst_frames(frames: Sequence[FrameEvidence], most: int) -> list[tuple[int, tuple[int, int]]]:
    """Which frames to look at first: places of the frame, and of the first and the last of its stretch.

    One of each stretch that is not accepted, the longest first, then the accepted ones that are least probable.
    """
    lost = [ends for ends in stretches(frames) if frames[ends[0]].verdict.state != ACCEPTED]
    lost.sort(key=lambda ends: ends[0] - ends[1])
    rows = [((first + last) // 2, (first, last)) for first, last in lost]
    accepted = [at for at, frame in enumerate(frames) if frame.verdict.state == ACCEPTED]
    accepted.sort(key=lambda at: (frames[at].verdict.probability, -frames[at].image_px))
    return [*rows, *((at, (at, at)) for at in accepted)][:most]
