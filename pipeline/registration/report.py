"""Registered frames as they are told: in a film and on a page, and in the record of a case."""

from dataclasses import dataclass, replace

import numpy as np

from ..camera.pinhole import PinholeCamera
from ..case.pose_record import REGISTERED, UNKNOWN, PoseRecord
from ..colour.source_view import SourceView
from .colour_sources import ColourChoice
from .register import RegisteredFrame
from .surface_check import SurfaceCheck
from .verdict import ACCEPTED, DOUBTFUL, REFUSED, WITHIN_PX, FilmChange, Verdict

COLOURS = {ACCEPTED: (70, 180, 90), DOUBTFUL: (230, 180, 40), REFUSED: (210, 60, 50)}
"""State of a frame -> its colour in pictures, sRGB."""
OPACITY = {ACCEPTED: (0.5, 1.0), DOUBTFUL: (0.2, 0.4), REFUSED: (0.0, 0.0)}
"""Least and greatest opacity of an overlay."""


@dataclass(frozen=True)
class FrameEvidence:
    """What is known of a frame.

    Attributes
    ----------
    name, number
        That of an image's file, and counted from 0; a frame of a video has no name.
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

    name: str
    number: int
    verdict: Verdict
    cam_from_model: np.ndarray | None
    rotation_deg: float = np.nan
    position_mm: float = np.nan
    image_px: float = np.nan
    picture: bytes | None = None

    @property
    def opacity(self) -> float:
        """The opacity of the overlay, 0..1: the less sure the fainter, none without a pose."""
        sure = 0.0 if self.cam_from_model is None else self.verdict.probability * (1 - 2 * self.image_px / WITHIN_PX)
        return float(np.clip(sure, *OPACITY[self.verdict.state]))

    def judged(self, found: RegisteredFrame) -> "FrameEvidence":
        """What is known once all frames are judged together."""
        if found.cam_from_model is None or found.uncertainty is None:
            return FrameEvidence(self.name, self.number, found.verdict, None, picture=self.picture)
        factor = found.uncertainty.largest_rotation_deg / self.rotation_deg
        return replace(
            self,
            verdict=found.verdict,
            rotation_deg=factor * self.rotation_deg,
            position_mm=factor * self.position_mm,
            image_px=factor * self.image_px,
        )

    def words(self, until: "FrameEvidence") -> str:
        """State and reason, of the frames from this one until another one."""
        one = self.name or f"frame {self.number}"
        frames = one if until is self else f"frames {self.number} to {until.number}"
        return f"{frames}, {self.verdict.state}: {self.verdict.reason}"


@dataclass(frozen=True)
class RegistrationEvidence:
    """What was found in all frames.

    Attributes
    ----------
    frames
        In their order.
    source
        The case's frame, at the size at which frames are registered.
    alignment
        The record of the case's pose.
    is_film
        Whether the frames follow each other.
    change
        What a film no longer shows as the case's frame does, if anything.
    colour
        The frames that colour the surface, if any were to be chosen.
    cut_off
        A sentence if the film is cut off, else empty.
    surface
        What the frames tell of the surface; ``None`` if they are too few or too near to one another.
    """

    frames: tuple[FrameEvidence, ...]
    source: SourceView
    alignment: PoseRecord
    is_film: bool
    change: FilmChange | None = None
    colour: ColourChoice | None = None
    cut_off: str = ""
    surface: SurfaceCheck | None = None

    @property
    def counts(self) -> dict[str, int]:
        """State -> number of frames."""
        states = [frame.verdict.state for frame in self.frames]
        return {state: states.count(state) for state in COLOURS}

    @property
    def lost(self) -> list[tuple[int, int]]:
        """Places of the first and the last frame of each stretch that is not accepted; images stand alone."""
        found = list[tuple[int, int]]()
        for at, frame in enumerate(self.frames):
            if frame.verdict.state == ACCEPTED:
                continue
            goes_on = at > 0 and self.is_film and frame.verdict.state == self.frames[at - 1].verdict.state
            found.append((found.pop()[0] if goes_on else at, at))
        return found

    @property
    def reasons(self) -> list[str]:
        """Why frames are not accepted: for each stretch what is said of its first frame."""
        return [self.frames[first].words(self.frames[last]) for first, last in self.lost]


def frame_evidence(
    name: str,
    number: int,
    found: RegisteredFrame,
    camera: PinholeCamera,
    points_model: np.ndarray,
    picture: bytes | None = None,
) -> FrameEvidence:
    """What is known of a frame of a camera; ``points_model`` ``(N, 3)`` stand for what is drawn over it."""
    pose, uncertainty = found.cam_from_model, found.uncertainty
    if pose is None or uncertainty is None:
        return FrameEvidence(name, number, found.verdict, None, picture=picture)
    return FrameEvidence(
        name,
        number,
        found.verdict,
        pose,
        uncertainty.largest_rotation_deg,
        float(np.sqrt(np.linalg.eigvalsh(uncertainty.covariance[:3, :3])[-1])),
        uncertainty.root_mean_square_px(points_model, camera, pose),
        picture,
    )


def registration_record(
    found: RegisteredFrame,
    camera: PinholeCamera,
    mesh_from_model: np.ndarray,
    source: PoseRecord,
    source_name: str,
    tool: str,
    date: str,
) -> PoseRecord:
    """The record of the frame's pose; an empty one if the frame is refused.

    Parameters
    ----------
    found
        The frame.
    camera
        The camera of the frame at its full size.
    mesh_from_model
        ``(4, 4)``, mm.
    source, source_name
        The record of the aligned frame's pose, and the name of its file.
    tool, date
        Program and version; day in ISO 8601.
    """
    if found.cam_from_model is None or found.uncertainty is None:
        return UNKNOWN
    # nobody knows how far it is off where the aligned frame's pose says nothing
    is_known = source.standard_deviation_mm is not None
    return PoseRecord(
        method=REGISTERED,
        tool=tool,
        date=date,
        doubt="" if found.verdict.state == ACCEPTED else found.verdict.reason,
        probability=found.verdict.probability,
        start_frame=source_name,
        start_method=source.method,
        error_px=found.uncertainty.spread_px(camera, found.cam_from_model) if is_known else None,
        **found.uncertainty.deviations(),
        **found.uncertainty.entry(mesh_from_model),
    )
