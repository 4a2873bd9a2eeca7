"""Correct the pose of a case's frame by further frames of its surface.

A pixel of the case's frame lies on the surface where its ray meets it: at a wrong pose in a wrong place. Frames
that see the place from other sides cannot all agree on it, whatever their poses, unless that is right. All
poses are found together, as in bundle adjustment (Triggs et al. 2000) with points that stay on the surface.
"""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ..alignment.levenberg_marquardt import Loss
from ..alignment.pose_uncertainty import PoseUncertainty
from ..alignment.reprojection import Poses, apply_twist, twist_jacobians
from ..camera.pinhole import PinholeCamera
from ..case.loaded_case import LoadedCase
from ..case.pose_record import FURTHER_FRAMES, UNKNOWN, PoseRecord
from ..errors import InputError
from ..files.numbers import format_two_digits
from ..least_squares import damped_least_squares
from ..projection.z_buffer import nearest_at
from ..surface.mesh import TriangleMesh
from ..transforms import camera_centre, cross_matrices, inverse_rigid, rotation_angle_deg, transform_points
from .flow_refinement import FlowFit
from .further_frames import FrameReader, FurtherFrame
from .register import Registrar
from .verdict import ACCEPTED, SPREAD, blocks_of

MOST_FRAMES, LEAST_FRAMES = 24, 3
MOST_PIXELS = 600
"""Pixels of a frame: more say nothing new."""
MOST_ROUNDS, SETTLED_PX = 6, 0.1
"""Rounds of flow and fit, and mean movement, at the size of registration, below which no further one follows."""
LEAST_AGREEMENT = 0.6
"""Share of the pixels that agree at the end: 0.7 to 0.85 where the pose comes back, up to 0.45 where it does not."""
LARGEST_DEG = 1.0
"""Standard deviation of the rotation above which the frames leave the pose open."""
LOSS = Loss(1.0)
MOST_STEPS, SETTLED = 60, 1e-6
"""Steps of a fit, and the share of the cost below which one is the last."""
STEEPEST = 0.2
"""Cosine between ray and normal below which a pixel's place on the surface is too uncertain."""
LEAST_BEND = 0.2
"""Below it, most pixels are outliers, and the formula for the covariance does not hold."""


def correct_pose(
    loaded: LoadedCase, folder_or_video: Path, *, tool: str, date: str, progress: Callable[[float], None]
) -> tuple[LoadedCase, str]:
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

    Returns
    -------
    The case with the new pose and its record, and in one sentence what has moved, and how sure it is.
    """
    registrar, reader, name = Registrar(loaded), FrameReader(loaded.case), folder_or_video.name
    with reader.opened(folder_or_video) as opened:
        every = -(-opened.count // MOST_FRAMES)
    with reader.opened(folder_or_video, every) as opened:
        frames = [each for each in opened.frames if not each.problem]
    try:
        corrected, fit, points = _settled(registrar, frames, progress)
        pose, pivot = fit.cam_from_model, registrar.pivot_model
        uncertainty = PoseUncertainty.about_points(pivot, SPREAD**2 * fit.covariance, points, pose)
        if uncertainty.largest_rotation_deg > LARGEST_DEG:
            raise InputError(
                "expected frames that determine the pose of the case's frame, found ±"
                f"{uncertainty.largest_rotation_deg:.1f}°; give frames from other sides"
            )
    except InputError as error:
        raise InputError(f"{name}: {error}; the pose is not corrected") from None
    moved_px, error_px = _moved_px(points, loaded, corrected), uncertainty.spread_px(loaded.case.camera, pose)
    moved_deg = rotation_angle_deg(pose[:3, :3] @ loaded.frame.cam_from_model[:3, :3].T)
    record = PoseRecord(
        method=FURTHER_FRAMES,
        tool=tool,
        date=date,
        start_method=loaded.case.alignment.method,
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
    return corrected.posed(corrected.case.cam_from_mesh, record), text


def _settled(
    registrar: Registrar, frames: Sequence[FurtherFrame], progress: Callable[[float], None]
) -> "tuple[LoadedCase, JointFit, np.ndarray]":
    """Register frames to the case and fit its pose to them, again and again until it stays.

    Returns the case at its new pose, the last fit, and the ``(N, 3)`` points that it is from.
    """
    poses, loaded, pivot = dict[int, np.ndarray](), registrar.loaded, registrar.pivot_model
    for number in range(MOST_ROUNDS):
        if poses:
            registrar = Registrar(loaded)
        fits, accepted = dict[int, FlowFit](), 0
        for done, frame in enumerate(frames, start=1):
            registered = registrar.register_alone(frame, poses.get(frame.number))
            if registered.fit is not None:
                fits[frame.number] = registered.fit
                accepted += registered.verdict.state == ACCEPTED
            progress((number + done / len(frames)) / MOST_ROUNDS)
        if len(fits) < LEAST_FRAMES:
            break
        correction = PoseCorrection(registrar.mesh, registrar.camera, pivot)
        fit = correction.fit(registrar.cam_from_model, [_track(registrar, each) for each in fits.values()])
        loaded = registrar.loaded.posed(fit.cam_from_model @ inverse_rigid(loaded.surface.mesh_from_model), UNKNOWN)
        poses = dict(zip(fits, fit.frames, strict=True))
        points = np.concatenate([each.points_model for each in fits.values()])
        moved_px = _moved_px(points, registrar.loaded, loaded) * registrar.camera.width / loaded.case.camera.width
        if moved_px < SETTLED_PX:
            break
    progress(1.0)
    # of the last round: at a wrong pose of the case's frame, few of the frames agree
    if accepted < LEAST_FRAMES:
        raise InputError(
            f"expected at least {LEAST_FRAMES} frames that show what the case's frame shows, from other sides, found "
            f"{accepted} of {len(frames)}"
        )
    if fit.agreement < LEAST_AGREEMENT:
        raise InputError(
            f"expected one pose of the case's frame with which the frames agree, found {fit.agreement:.0%} of "
            "their pixels in agreement; the pose is too far off, or the surface is wrong: align the frame again"
        )
    return loaded, fit, points


def _moved_px(points_model: np.ndarray, before: LoadedCase, after: LoadedCase) -> float:
    """How far points ``(N, 3)`` move in the case's frame, in the mean, px."""
    seen = (
        each.case.camera.project(transform_points(each.frame.cam_from_model, points_model)) for each in (before, after)
    )
    return float(np.linalg.norm(np.subtract(*seen), axis=1).mean())


def _track(registrar: Registrar, fit: FlowFit) -> "Track":
    chosen = fit.returning(MOST_PIXELS)
    case_px = registrar.camera.project(transform_points(registrar.cam_from_model, fit.points_model[chosen]))
    return Track(case_px, fit.moved[chosen], fit.cam_from_model)


class Track(NamedTuple):
    """What a registered frame shares with the case's frame.

    Pixels ``(N, 2)`` of the case's, where the frame shows them, and its pose ``cam_from_model`` ``(4, 4)``, mm.
    """

    case_px: np.ndarray
    frame_px: np.ndarray
    cam_from_model: np.ndarray


class JointFit(NamedTuple):
    """The poses that fit together.

    Attributes
    ----------
    cam_from_model
        ``(4, 4)`` that of the case's frame, mm.
    frames
        ``(F, 4, 4)`` those of the frames, mm.
    covariance
        ``(6, 6)`` of the twist of the case's frame about the pivot, mm and radians along the camera's axes.
    agreement
        Mean weight of the pixels, 0..1: low at a pose that is not near the right one, and on a wrong surface.
    """

    cam_from_model: np.ndarray
    frames: np.ndarray
    covariance: np.ndarray
    agreement: float


class _Linear(NamedTuple):
    """Residuals ``(N, 2)``, their weights ``(N,)`` and cost, and derivatives by the twists of both frames."""

    residuals: np.ndarray
    weight: np.ndarray
    cost: float
    jacobian: np.ndarray


class PoseCorrection:
    """Finds the pose of the case's frame from tracks."""

    def __init__(self, mesh: TriangleMesh, camera: PinholeCamera, pivot_model: np.ndarray) -> None:
        """Prepare a surface (model frame) and the camera of all frames; twists are about the ``(3,)`` pivot, mm."""
        self._mesh, self._camera, self._pivot = mesh, camera, pivot_model

    def fit(self, case_from_model: np.ndarray, tracks: Sequence[Track]) -> JointFit:
        """The poses that fit together, from a rough one ``(4, 4)`` of the case's frame; every track has pixels."""
        poses = np.stack([case_from_model, *(track.cam_from_model for track in tracks)])
        number = np.repeat(np.arange(len(tracks)), [len(track.case_px) for track in tracks])
        case_px, frame_px = (np.concatenate(each) for each in list(zip(*tracks, strict=True))[:2])

        def better(before: tuple[np.ndarray, _Linear], step: np.ndarray) -> tuple[np.ndarray, _Linear] | None:
            twists = zip(step.reshape(-1, 6), before[0], strict=True)
            moved = np.stack([apply_twist(*each, self._pivot) for each in twists])
            after = self._linear(moved, case_px, frame_px, number)
            return (moved, after) if after.cost < before[1].cost else None

        poses, now = damped_least_squares(
            (poses, self._linear(poses, case_px, frame_px, number)),
            lambda state: _normal_equations(state[1], number),
            better,
            lambda before, after: before[1].cost - after[1].cost < SETTLED * before[1].cost,
            steps=MOST_STEPS,
        )
        return JointFit(poses[0], poses[1:], _covariance(now, number, case_px), float(now.weight.mean()))

    def _linear(self, poses: np.ndarray, case_px: np.ndarray, frame_px: np.ndarray, number: np.ndarray) -> _Linear:
        """All pixels, each with the number of its frame, at the poses of the case's frame and the others."""
        camera, case_from_model = self._camera, poses[0]
        rays_cam = camera.rays_cam(case_px)
        depths_mm, normals_cam, met = self._hits(case_from_model, case_px)
        points_cam = depths_mm[:, None] * rays_cam
        points_model = (points_cam - case_from_model[:3, 3]) @ case_from_model[:3, :3]
        frames = Poses.of(poses[1:], self._pivot)[number]
        offsets_cam = np.einsum("nij,nj->ni", frames.rotations, points_model - self._pivot)
        residuals = frame_px - camera.project(offsets_cam + frames.positions)
        cost, weight = LOSS(np.where(met, (residuals**2).sum(axis=1), np.nan))
        by_frame = twist_jacobians(camera, offsets_cam[:, None], frames.positions)[:, 0]
        # a point moves against the twist of the case's frame, and along its ray back to the surface
        facing = np.where(met, (normals_cam * rays_cam).sum(axis=1), 1.0)
        slide = np.eye(3) - rays_cam[:, :, None] * normals_cam[:, None] / facing[:, None, None]
        turn = cross_matrices(points_cam - transform_points(case_from_model, self._pivot[None]))
        moved = slide @ np.concatenate([np.broadcast_to(-np.eye(3), turn.shape), turn], axis=2)
        by_case = by_frame[:, :, :3] @ frames.rotations @ case_from_model[:3, :3].T @ moved
        jacobian, known = np.concatenate([by_case, by_frame], axis=2), (weight > 0)[:, None]
        residuals, jacobian = np.where(known, residuals, 0.0), np.where(known[..., None], jacobian, 0.0)
        return _Linear(residuals, weight, float(cost.sum()), jacobian)

    def _hits(self, case_from_model: np.ndarray, case_px: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Depths ``(N,)``, unit normals ``(N, 3)`` in camera axes, and which rays meet the surface not too steeply."""
        rays, origin = self._camera.rays_cam(case_px) @ case_from_model[:3, :3], camera_centre(case_from_model)
        face = nearest_at(self._mesh, self._camera, case_from_model, case_px)[1]
        normals, corners = self._mesh.face_normals[face], self._mesh.vertices[self._mesh.faces[face, 0]]
        facing = (normals * rays).sum(axis=1)
        met = (face >= 0) & (np.abs(facing) > STEEPEST * np.linalg.norm(rays, axis=1))
        depths_mm = ((corners - origin) * normals).sum(axis=1) / np.where(met, facing, 1.0)
        return np.where(met, depths_mm, 1.0), normals @ case_from_model[:3, :3].T, met


def _normal_equations(linear: _Linear, number: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """J^T W J ``(6 + 6 F, 6 + 6 F)`` and J^T W r of the twists of the case's frame and of F others."""
    count = number.max() + 1
    normal, gradient = np.zeros((6 * count + 6,) * 2), np.zeros(6 * count + 6)
    for frame in range(count):
        own = number == frame
        both = [*range(6), *range(6 + 6 * frame, 12 + 6 * frame)]
        weighted = linear.jacobian[own] * linear.weight[own, None, None]
        normal[np.ix_(both, both)] += np.tensordot(weighted, linear.jacobian[own], ((0, 1), (0, 1)))
        gradient[both] += np.tensordot(weighted, linear.residuals[own], ((0, 1), (0, 1)))
    return normal, gradient


def _covariance(linear: _Linear, number: np.ndarray, case_px: np.ndarray) -> np.ndarray:
    """The ``(6, 6)`` covariance of that of the case, robust against errors shared in a block (Liang & Zeger 1986).

    The blocks are those of the case's frame: a wrong surface errs alike in all frames.
    """
    inverse = np.linalg.inv(_normal_equations(linear, number)[0])[:6]
    own = np.stack([inverse[:, 6 + 6 * frame : 12 + 6 * frame] for frame in range(number.max() + 1)])[number]
    by_twist = np.concatenate([np.broadcast_to(inverse[:, :6], own.shape), own], axis=2)
    pulled = np.einsum("nij,ncj,nc,n->ni", by_twist, linear.jacobian, linear.residuals, linear.weight)
    count, block = blocks_of(case_px)
    sums = np.zeros((count, 6))
    np.add.at(sums, block, pulled)
    # the loss bends: its second derivative is less than the weight (Huber 1981), in the mean over both directions
    weight = linear.weight
    bend = max(float((weight * (2 * np.sqrt(weight) - 1)).sum() / weight.sum()), LEAST_BEND)
    return sums.T @ sums / bend**2
