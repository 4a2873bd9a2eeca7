"""Displacements of a surface's points and twists of the frames' poses, from flow: one robust sparse least squares.

A pixel of one frame shows a point, another frame shows it somewhere else than surface and poses say: the point moves
along its ray as the surface moves along its normals, and with both poses. Far residuals have little weight (Geman &
McClure), neighbours move alike, poses stay near where they were; what moves without need is drawn back.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from scipy import sparse
from scipy.sparse.linalg import splu

from ..alignment.reprojection import apply_twist, jacobian_at, twist_between
from ..transforms import cross_matrices, transform_points
from .control_points import ControlPoints
from .frame_flow import Flow, SurfaceView

LEAST_COS = 0.2
"""Cosine between ray and face, and between face and smooth normal, below which a displacement has no certain effect."""
FLOW_PX, ROBUST_PX = 0.35, 0.7
"""Standard deviation of flow, where two pixels of the grid err together, and residual from which weights fall."""
SMOOTH_PX, FAR_PX = 0.5, 1.0
"""Standard deviations of a point against its neighbours, and from its place (Cauchy), in pixels on the surface: little
holds what is far off, but the rest must not drift with the poses, of which flow hardly tells."""
STEPS = 2
MOST_SQUARE = 4.0
"""px²: one far residual does not tell of a place."""


class Observed(NamedTuple):
    """N pixels whose flow is known, linearised.

    Attributes
    ----------
    frames
        ``(N, 2)`` numbers of the frame of the pixel, and of the other one.
    residuals
        ``(N, 2)`` found minus placed, px.
    by_height
        ``(N, 2)`` derivative by a displacement of the surface, px a mm.
    weights
        ``(N, M)`` sparse: the displacement there from those of the points.
    by_poses
        ``(N, 2, 12)`` derivative by the twists of both frames.
    """

    frames: np.ndarray
    residuals: np.ndarray
    by_height: np.ndarray
    weights: sparse.csr_matrix
    by_poses: np.ndarray

    @classmethod
    def joined(cls, parts: Sequence["Observed"]) -> "Observed":
        """All of them."""
        return cls(
            *(
                sparse.vstack(each, format="csr") if sparse.issparse(each[0]) else np.concatenate(each)
                for each in zip(*parts, strict=True)
            )
        )


def observed(
    points: ControlPoints, pivot: np.ndarray, views: Sequence[SurfaceView], pair: tuple[int, int], flow: Flow
) -> Observed:
    """Linearise the flow of a pair of views about a pivot ``(3,)``, model frame."""
    view, other = (views[number] for number in pair)
    u, v = flow.pixels.T
    row = v * view.depth_mm.shape[1] + u
    face = view.hits.face[row]
    corners = points.mesh.faces[face]
    second, third = (each[row].astype(float) for each in (view.hits.second, view.hits.third))
    parts = np.stack([1 - second - third, second, third], axis=1)
    rays = view.rays[v, u]
    normals = view.surface.mesh.face_normals[face]
    smooth = np.einsum("nk,nki->ni", parts, points.normals[corners])
    along = (normals * rays).sum(axis=1)
    alike = (smooth * normals).sum(axis=1)
    # on the side that is seen, whichever way the face is wound
    used = (np.abs(along) > LEAST_COS * np.linalg.norm(rays, axis=1)) & (np.abs(alike) > LEAST_COS)
    flow_px, corners, parts, rays, normals, along, alike = (
        each[used] for each in (flow.found - flow.placed, corners, parts, rays, normals, along, alike)
    )
    at, u, v = view.points[v[used], u[used]], u[used], v[used]
    by_other = jacobian_at(at, other.frame.camera, other.pose, pivot)
    by_point = by_other[..., :3] @ other.pose[:3, :3]
    # the pixel stays, so the point slides along its ray until it is on the moved surface
    turn = view.pose[:3, :3]
    offsets_cam = transform_points(view.pose, at) - transform_points(view.pose, pivot)
    slide = -turn.T @ np.concatenate(
        [np.broadcast_to(np.eye(3), (len(at), 3, 3)), -cross_matrices(offsets_cam)], axis=2
    )
    slide -= rays[:, :, None] * (np.einsum("ni,nik->nk", normals, slide) / along[:, None])[:, None]
    by_height = np.einsum("nij,nj->ni", by_point, rays * (alike / along)[:, None])
    begins, shape = 3 * np.arange(len(at) + 1), (len(at), len(points.normals))
    weights = sparse.csr_matrix((parts.ravel(), corners.ravel(), begins), shape) @ points.weights
    by_poses = np.concatenate([by_point @ slide, by_other], axis=2)
    return Observed(np.tile(pair, (len(at), 1)), flow_px, by_height, weights, by_poses)


@dataclass(frozen=True)
class Estimate:
    """Where surface and poses are, and where they may go.

    Attributes
    ----------
    heights_mm
        ``(M,)`` displacements of the points along the normals, from the surface as it came.
    poses, starts
        ``(F, 4, 4)`` ``cam_from_model``, mm, and those with which the frames came.
    deviations
        ``(F, 6)`` standard deviations of the twists from there, mm and radians.
    pivot
        ``(3,)`` mm, model frame: twists are about it.
    pixel_mm
        Size of a pixel on the surface.
    """

    heights_mm: np.ndarray
    poses: np.ndarray
    starts: np.ndarray
    deviations: np.ndarray
    pivot: np.ndarray
    pixel_mm: float


@dataclass(frozen=True)
class Fit:
    """Displacements and poses that fit together.

    Attributes
    ----------
    estimate
        Where they are now.
    std_mm
        ``(M,)`` standard deviations of the displacements, of each as if flow told of it alone.
    residuals_px
        ``(M,)`` root mean square of what is left around each point.
    counts
        ``(M,)`` how many pixels tell of each point, by their weights.
    left_px
        ``(N,)`` what is left at each pixel.
    weight
        Mean weight of all pixels.
    """

    estimate: Estimate
    std_mm: np.ndarray
    residuals_px: np.ndarray
    counts: np.ndarray
    left_px: np.ndarray
    weight: float


def fit(points: ControlPoints, known: Observed, now: Estimate) -> Fit:
    """Fit displacements and poses."""
    heights, count, pixels = now.heights_mm, len(now.heights_mm), len(known.residuals)
    far_mm, stiff = FAR_PX * now.pixel_mm, 1 / now.deviations.ravel() ** 2
    bending = (points.bending.T @ points.bending) / (SMOOTH_PX * now.pixel_mm) ** 2
    away = np.concatenate([twist_between(*each, now.pivot) for each in zip(now.starts, now.poses, strict=True)])
    # a row for each coordinate of each pixel
    residuals = known.residuals.T.ravel()
    by_points = sparse.diags(known.by_height.T.ravel()) @ sparse.vstack([known.weights] * 2)
    columns, begins = np.tile((6 * known.frames[:, :, None] + np.arange(6)).ravel(), 2), 12 * np.arange(2 * pixels + 1)
    twists = np.moveaxis(known.by_poses, 1, 0).ravel()
    by_poses = sparse.csr_matrix((twists, columns, begins), (2 * pixels, len(stiff)))
    weight, step = np.ones(pixels), np.zeros(count)
    for _ in range(STEPS):
        each = sparse.diags(np.tile(weight, 2) / FLOW_PX**2)
        draw = 1 / far_mm**2 / (1 + ((heights + step) / far_mm) ** 2)
        moved, posed = (each @ by_points).T, (each @ by_poses).T
        right = moved @ residuals - bending @ heights - draw * heights
        pose_right = posed @ residuals - stiff * away
        # the poses from what is left when the displacements are eliminated (Schur complement)
        own, cross = bending + sparse.diags(draw) + moved @ by_points, (moved @ by_poses).toarray()
        factor = splu(own.tocsc(), permc_spec="MMD_AT_PLUS_A", options={"SymmetricMode": True})
        through = factor.solve(cross)
        reduced = np.diag(stiff) + (posed @ by_poses).toarray() - cross.T @ through
        twist = np.linalg.solve(reduced, pose_right - through.T @ right)
        step = factor.solve(right - cross @ twist)
        left = residuals - by_points @ step - by_poses @ twist
        squares = (left**2).reshape(2, pixels).sum(axis=0)
        weight = 1 / (1 + squares / ROBUST_PX**2) ** 2
    shares = np.asarray(known.weights.sum(axis=0)).ravel()
    told = known.weights.T @ (weight * (known.by_height**2).sum(axis=1)) / FLOW_PX**2
    poses = [apply_twist(each, pose, now.pivot) for each, pose in zip(twist.reshape(-1, 6), now.poses, strict=True)]
    return Fit(
        replace(now, heights_mm=heights + step, poses=np.stack(poses)),
        1 / np.sqrt(told + draw),
        np.sqrt((known.weights.T @ np.minimum(squares, MOST_SQUARE)) / np.maximum(shares, 1e-9)),
        known.weights.T @ weight,
        np.sqrt(squares),
        float(weight.mean()),
    )
