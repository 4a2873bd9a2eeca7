"""Correct the aligned frame's pose by the frames that were registered to it.

A pixel of the aligned frame, the source, lies on the surface where its ray meets it: at a wrong pose of the source in a
wrong place. Frames that see the place from other sides cannot all agree on it, whatever their poses, unless the
source's is right. All poses are found together, as in bundle adjustment (Triggs et al. 2000) with points that stay on
the surface; those of the frames are eliminated (Schur complement).

What surface and source are off is part of the uncertainty of every pose that is registered to them.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from ..alignment.levenberg_marquardt import Loss
from ..alignment.pose_uncertainty import PoseUncertainty
from ..alignment.reprojection import Poses, apply_twist, twist_jacobians
from ..camera.pinhole import PinholeCamera
from ..files.numbers import format_two_digits
from ..projection.rays import MeshRays
from ..surface.mesh import TriangleMesh
from ..transforms import camera_centre, cross_matrices, transform_points
from .register import RegisteredFrame
from .verdict import ACCEPTED, DOUBTFUL, LEAST_ACCEPTED, blocks_of, within

LOSS = Loss(1.0)
MOST_STEPS, SETTLED = 60, 1e-6
"""Steps, and the share of the cost below which a step is the last."""
STEEPEST = 0.2
"""Cosine between ray and normal below which a pixel's place on the surface is too uncertain."""
LEAST_BEND = 0.2
"""Below it, most pixels are outliers, and the formula for the covariance does not hold."""


@dataclass(frozen=True)
class Track:
    """What a registered frame shares with the source.

    Attributes
    ----------
    source_px, frame_px
        ``(N, 2)`` pixels of the source, and where the frame shows them.
    cam_from_model
        ``(4, 4)`` the frame's pose, mm.
    """

    source_px: np.ndarray
    frame_px: np.ndarray
    cam_from_model: np.ndarray


class SourceFit(NamedTuple):
    """The poses that fit together.

    Attributes
    ----------
    cam_from_model
        ``(4, 4)`` the source's, mm.
    frames
        ``(F, 4, 4)`` those of the frames, mm.
    covariance
        ``(6, 6)`` of the source's twist about the pivot, mm and radians along the camera's axes.
    agreement
        Mean weight of the pixels, 0..1: low at a pose that is not near the right one, and on a wrong surface.
    """

    cam_from_model: np.ndarray
    frames: np.ndarray
    covariance: np.ndarray
    agreement: float


class _Pixels(NamedTuple):
    """``(N, 2)`` pixels of the source, ``(N, 2)`` where a frame shows them, and ``(N,)`` the number of the frame."""

    source: np.ndarray
    frame: np.ndarray
    number: np.ndarray


class _Linear(NamedTuple):
    """Residuals ``(N, 2)``, their weights ``(N,)`` and cost, and derivatives ``(N, 2, 6)`` by the twists."""

    residuals: np.ndarray
    weight: np.ndarray
    cost: float
    by_source: np.ndarray
    by_frame: np.ndarray


class _Normal(NamedTuple):
    """Normal equations: of the source with the frames eliminated, and what finds the frames' twists afterwards."""

    reduced: np.ndarray
    right: np.ndarray
    inverses: np.ndarray
    own_rights: np.ndarray
    crosses: np.ndarray


class SourceCorrection:
    """Finds the source's pose from tracks."""

    def __init__(self, mesh: TriangleMesh, camera: PinholeCamera, pivot_model: np.ndarray) -> None:
        """Prepare a surface (model frame) and the camera of all frames; twists are about the ``(3,)`` pivot, mm."""
        self._mesh, self._rays, self._camera, self._pivot = mesh, MeshRays(mesh), camera, pivot_model

    def fit(self, source: np.ndarray, tracks: Sequence[Track]) -> SourceFit:
        """The poses that fit together, from a rough one ``(4, 4)`` of the source; every track has pixels."""
        frames = np.stack([track.cam_from_model for track in tracks])
        number = np.repeat(np.arange(len(tracks)), [len(track.source_px) for track in tracks])
        source_px, frame_px = (
            np.concatenate(each) for each in zip(*((track.source_px, track.frame_px) for track in tracks), strict=True)
        )
        pixels = _Pixels(source_px, frame_px, number)
        now, damping = self._linear(source, frames, pixels), 1e-4
        for _ in range(MOST_STEPS):
            normal = _normal(now, number, damping)
            step = np.linalg.solve(normal.reduced, normal.right)
            steps = np.einsum("fij,fj->fi", normal.inverses, normal.own_rights - step @ normal.crosses)
            moved = np.stack([apply_twist(*each, self._pivot) for each in zip(steps, frames, strict=True)])
            next_source = apply_twist(step, source, self._pivot)
            tried = self._linear(next_source, moved, pixels)
            if tried.cost >= now.cost:
                damping *= 10
                continue
            is_last = now.cost - tried.cost < SETTLED * now.cost
            source, frames, now, damping = next_source, moved, tried, damping / 10
            if is_last:
                break
        return SourceFit(source, frames, _covariance(now, number, source_px), float(now.weight.mean()))

    def _linear(self, source: np.ndarray, frames: np.ndarray, pixels: _Pixels) -> _Linear:
        """All pixels at some poses."""
        camera = self._camera
        rays_cam = camera.rays_cam(pixels.source)
        depths_mm, normals_cam, met = self._hits(source, rays_cam)
        points_cam = depths_mm[:, None] * rays_cam
        points_model = (points_cam - source[:3, 3]) @ source[:3, :3]
        poses = Poses.of(frames, self._pivot)[pixels.number]
        offsets_cam = np.einsum("nij,nj->ni", poses.rotations, points_model - self._pivot)
        residuals = pixels.frame - camera.project(offsets_cam + poses.positions)
        cost, weight = LOSS(np.where(met, (residuals**2).sum(axis=1), np.nan))
        by_frame = twist_jacobians(camera, offsets_cam[:, None], poses.positions)[:, 0]
        # a point moves against the source's twist, and along its ray back to the surface
        facing = np.where(met, (normals_cam * rays_cam).sum(axis=1), 1.0)
        slide = np.eye(3) - rays_cam[:, :, None] * normals_cam[:, None] / facing[:, None, None]
        turn = cross_matrices(points_cam - transform_points(source, self._pivot[None]))
        moved = slide @ np.concatenate([np.broadcast_to(-np.eye(3), turn.shape), turn], axis=2)
        by_source = by_frame[:, :, :3] @ poses.rotations @ source[:3, :3].T @ moved
        known = weight > 0
        residuals, by_source, by_frame = (
            np.where(known.reshape(-1, *[1] * (each.ndim - 1)), each, 0.0) for each in (residuals, by_source, by_frame)
        )
        return _Linear(residuals, weight, float(cost.sum()), by_source, by_frame)

    def _hits(self, source: np.ndarray, rays_cam: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Depths ``(N,)``, unit normals ``(N, 3)`` in camera axes, and which rays meet the surface not too steeply."""
        rays, origin = rays_cam @ source[:3, :3], camera_centre(source)
        origins = np.tile(origin.astype(np.float32), (len(rays), 1))
        face = self._rays.first_hits(origins, rays.astype(np.float32)).face
        # in double precision: Embree's depth would not move with the source by small steps
        corners = self._mesh.vertices[self._mesh.faces[np.maximum(face, 0)]]
        normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-300)
        facing = (normals * rays).sum(axis=1)
        met = (face >= 0) & (np.abs(facing) > STEEPEST * np.linalg.norm(rays, axis=1))
        depths_mm = ((corners[:, 0] - origin) * normals).sum(axis=1) / np.where(met, facing, 1.0)
        return np.where(met, depths_mm, 1.0), normals @ source[:3, :3].T, met


def _normal(linear: _Linear, number: np.ndarray, damping: float) -> _Normal:
    starts = np.flatnonzero(np.diff(number, prepend=-1))
    by_source, by_frame, weight = linear.by_source, linear.by_frame, linear.weight
    own = (1 + damping * np.eye(6)) * np.add.reduceat(np.einsum("nci,ncj,n->nij", by_frame, by_frame, weight), starts)
    crosses = np.add.reduceat(np.einsum("nci,ncj,n->nij", by_source, by_frame, weight), starts)
    own_rights = np.add.reduceat(np.einsum("nci,nc,n->ni", by_frame, linear.residuals, weight), starts)
    inverses = np.linalg.inv(own)
    source = np.einsum("nci,ncj,n->ij", by_source, by_source, weight)
    source += damping * np.diag(np.diag(source))
    right = np.einsum("nci,nc,n->i", by_source, linear.residuals, weight)
    return _Normal(
        reduced=source - np.einsum("fij,fjk,flk->il", crosses, inverses, crosses),
        right=right - np.einsum("fij,fjk,fk->i", crosses, inverses, own_rights),
        inverses=inverses,
        own_rights=own_rights,
        crosses=crosses,
    )


def _covariance(linear: _Linear, number: np.ndarray, source_px: np.ndarray) -> np.ndarray:
    """The covariance of the source's unknowns, robust against errors shared within a block (Liang & Zeger 1986).

    The blocks are the source's: a wrong surface errs alike in all frames.
    """
    normal = _normal(linear, number, 0.0)
    eliminated = (normal.crosses @ normal.inverses)[number]
    alone = linear.by_source - np.einsum("nci,nji->ncj", linear.by_frame, eliminated)
    count, block = blocks_of(source_px)
    sums = np.zeros((count, alone.shape[2]))
    np.add.at(sums, block, np.einsum("nci,nc,n->ni", alone, linear.residuals, linear.weight))
    # the loss bends: its second derivative is less than the weight (Huber 1981), in the mean over both directions
    weight = linear.weight
    bend = float((weight * (2 * np.sqrt(weight) - 1)).sum() / weight.sum())
    inverse = np.linalg.inv(normal.reduced) / max(bend, LEAST_BEND)
    return inverse @ (sums.T @ sums) @ inverse


SURFACE_SHARE = 1 / 3000
"""Standard deviation of the surface's depth as a whole, seen from the aligned frame, relative to the distance: 0.1 mm
at 300 mm. Two surfaces from CT with voxels of 0.4 mm were 0.05 and 0.1 mm off; half or twice as much covers as many."""


def with_case(
    found: RegisteredFrame, source: PoseUncertainty | None, source_from_model: np.ndarray, camera: PinholeCamera
) -> RegisteredFrame:
    """A registered frame whose covariance, probability and state include what surface and aligned frame are off.

    To first order, what the aligned frame shows moves with its pose as a whole, and takes the others along. A surface
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
        The camera of the frames.
    """
    pose, own = found.cam_from_model, found.uncertainty
    if pose is None or own is None:
        return found
    way = np.append(pose[:3, :3] @ (camera_centre(pose) - camera_centre(source_from_model)), np.zeros(3))
    uncertainty = replace(own, covariance=own.covariance + SURFACE_SHARE**2 * np.outer(way, way))
    if source is not None:
        turn = np.kron(np.eye(2), pose[:3, :3] @ source_from_model[:3, :3].T)
        uncertainty = replace(own, covariance=uncertainty.covariance + turn @ source.covariance @ turn.T)
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
