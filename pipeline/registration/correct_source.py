"""Correct the pose of a case by further frames of its surface."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ..alignment.pose_uncertainty import PoseUncertainty
from ..case.loaded_case import LoadedCase
from ..case.pose_record import FURTHER_FRAMES, UNKNOWN, PoseRecord
from ..errors import InputError
from ..files.numbers import format_two_digits
from ..transforms import inverse_rigid, rotation_angle_deg, transform_points
from .colour_sources import Candidate
from .flow_refinement import FlowFit
from .register_frames import CaseRegistrar, FurtherFrame
from .source_correction import SourceCorrection, SourceFit, Track
from .surface_check import SurfaceCheck
from .verdict import ACCEPTED, SPREAD

MOST_FRAMES, LEAST_FRAMES = 24, 3
MOST_PIXELS = 600
"""Pixels of a frame: more say nothing new."""
MOST_ROUNDS, SETTLED_PX = 6, 0.1
"""Rounds of flow and fit, and mean movement, at the size of registration, below which no further one follows."""
LEAST_AGREEMENT = 0.6
"""Share of the pixels that agree at the end: 0.7 to 0.85 where the pose comes back, up to 0.45 where it does not."""
LARGEST_DEG = 1.0
"""Standard deviation of the rotation above which the frames leave the pose open."""
MOST_WRONG = 0.5
"""Of the places that frames put elsewhere at the case's pose, the part that may be there at the corrected one too: 0.02
where that pose was off, 0.7 and more where the surface is wrong."""


@dataclass(frozen=True)
class CorrectedSource:
    """A case whose pose was corrected.

    Attributes
    ----------
    loaded
        With the new pose and its record.
    text
        What has moved, and how sure it is, in one sentence.
    """

    loaded: LoadedCase
    text: str


def correct_source(
    loaded: LoadedCase,
    folder_or_video: Path,
    *,
    tool: str,
    date: str,
    progress: Callable[[float], None],
) -> CorrectedSource:
    """Correct the pose of a case by frames of a folder or a video, spread evenly over it.

    Parameters
    ----------
    loaded
        The case at its pose, which may be some degrees off.
    folder_or_video
        Folder of images, or a video.
    tool, date
        For the record in the case.
    progress
        Called with the finished share, 0..1.

    Raises
    ------
    InputError
        The frames cannot be used, too few of them are accepted, they leave the pose open, or they put the surface
        elsewhere at the corrected pose too.
    """
    registrar, name, first = CaseRegistrar(loaded), folder_or_video.name, loaded
    with registrar.frames(folder_or_video) as opened:
        every = -(-opened.count // MOST_FRAMES)
    with registrar.frames(folder_or_video, every) as opened:
        frames = [each for each in opened.frames if not each.problem]
    try:
        found = _settled(registrar, frames, progress)
        _check(found, frames)
    except InputError as error:
        raise InputError(f"{name}: {error}; the pose is not corrected") from None
    loaded, fit, points = found.loaded, found.fit, found.points_model
    camera, pose, pivot = loaded.case.camera, fit.cam_from_model, registrar.pivot_model
    uncertainty = PoseUncertainty.about_points(pivot, SPREAD**2 * fit.covariance, points, pose)
    if uncertainty.largest_rotation_deg > LARGEST_DEG:
        raise InputError(
            f"{name}: expected frames that determine the pose of the case's frame, found ±"
            f"{uncertainty.largest_rotation_deg:.1f}°; give frames from other sides; the pose is not corrected"
        )
    moved_px = _moved_px(points, first, loaded)
    moved_deg = rotation_angle_deg(pose[:3, :3] @ first.frame.cam_from_model[:3, :3].T)
    error_px = uncertainty.spread_px(camera, pose)
    record = PoseRecord(
        method=FURTHER_FRAMES,
        tool=tool,
        date=date,
        start_method=first.case.alignment.method,
        error_px=error_px,
        moved_px=moved_px,
        moved_deg=moved_deg,
        **uncertainty.deviations(),
        **uncertainty.entry(loaded.surface.mesh_from_model),
    )
    text = (
        f"the pose of the case's frame is corrected by {moved_deg:.2g}° and {format_two_digits(moved_px)} px, from "
        f"{len(fit.frames)} further frames; if the surface is right, it is off by about "
        f"{format_two_digits(error_px)} px, least certain: {uncertainty.weakest}"
    )
    return CorrectedSource(loaded.posed(loaded.case.cam_from_mesh, record), text)


class _Settled(NamedTuple):
    """A case whose pose the frames have found, the fit of the last round, and points ``(N, 3)`` that it is from.

    ``before`` is what the frames said of the surface at the case's own pose, ``poses`` are the frames', by number.
    """

    loaded: LoadedCase
    fit: SourceFit
    points_model: np.ndarray
    before: SurfaceCheck | None
    poses: Mapping[int, np.ndarray]


def _settled(registrar: CaseRegistrar, frames: Sequence[FurtherFrame], progress: Callable[[float], None]) -> _Settled:
    """Register frames to the case and fit its pose to them, again and again until it stays."""
    poses, pivot, before = dict[int, np.ndarray](), registrar.pivot_model, None
    loaded = registrar.loaded
    for number in range(MOST_ROUNDS):
        if poses:
            registrar = CaseRegistrar(loaded)
        fits, accepted = dict[int, FlowFit](), 0
        for done, frame in enumerate(frames):
            found = registrar.registered_alone(frame, poses.get(done))
            if found.fit is not None:
                fits[done] = found.fit
                accepted += found.verdict.state == ACCEPTED
            progress((number + (done + 1) / len(frames)) / MOST_ROUNDS)
        if len(fits) < LEAST_FRAMES:
            break
        if not poses:
            before = _checked(registrar, frames, {done: each.cam_from_model for done, each in fits.items()})
        correction = SourceCorrection(registrar.mesh, registrar.camera, pivot)
        fit = correction.fit(registrar.cam_from_model, [_track(registrar, each) for each in fits.values()])
        was = registrar.loaded
        loaded = was.posed(fit.cam_from_model @ inverse_rigid(was.surface.mesh_from_model), UNKNOWN)
        poses = dict(zip(fits, fit.frames, strict=True))
        points = np.concatenate([each.points_model for each in fits.values()])
        moved_px = _moved_px(points, was, loaded) * registrar.camera.width / loaded.case.camera.width
        if moved_px < SETTLED_PX:
            break
    progress(1.0)
    # of the last round: at a wrong pose of the case's frame, few of the frames agree
    if accepted < LEAST_FRAMES:
        raise InputError(
            f"expected at least {LEAST_FRAMES} frames that show what the case's frame shows, from other sides, found "
            f"{accepted} of {len(frames)}"
        )
    return _Settled(loaded, fit, points, before, poses)


def _check(found: _Settled, frames: Sequence[FurtherFrame]) -> None:
    """Refuse a pose with which frames and surface do not agree."""
    if found.fit.agreement < LEAST_AGREEMENT:
        raise InputError(
            f"expected one pose of the case's frame with which the frames agree, found {found.fit.agreement:.0%} of "
            "their pixels in agreement; the pose is too far off, or the surface is wrong: align the frame again"
        )
    if found.before is None:
        return
    now = _checked(CaseRegistrar(found.loaded), frames, found.poses)
    if now is not None and now.words and now.share > MOST_WRONG * found.before.share:
        raise InputError(
            "expected a pose of the case's frame at which the frames agree with the surface, found none: "
            f"{now.words}; take a surface of the stage that the frames show"
        )


def _checked(
    registrar: CaseRegistrar, frames: Sequence[FurtherFrame], poses: Mapping[int, np.ndarray]
) -> SurfaceCheck | None:
    found = (Candidate(at, frames[at].image, frames[at].valid, pose) for at, pose in poses.items())
    return registrar.checked_surface(list(found))


def _moved_px(points_model: np.ndarray, before: LoadedCase, after: LoadedCase) -> float:
    """How far points ``(N, 3)`` move in the case's frame, in the mean, px."""
    seen = (
        each.case.camera.project(transform_points(each.frame.cam_from_model, points_model)) for each in (before, after)
    )
    return float(np.linalg.norm(np.subtract(*seen), axis=1).mean())


def _track(registrar: CaseRegistrar, fit: FlowFit) -> Track:
    chosen = fit.returning(MOST_PIXELS)
    source_px = registrar.camera.project(transform_points(registrar.cam_from_model, fit.points_model[chosen]))
    return Track(source_px, fit.moved[chosen], fit.cam_from_model)
