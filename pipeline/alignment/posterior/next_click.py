"""Where on the surface the next landmark gains most, and which of its places a person recognises without colours."""

from collections.abc import Sequence

import cv2
import numpy as np

from ...camera.pinhole import PinholeCamera
from ...case.landmarks import Landmark
from ...projection.z_buffer import rasterise_depth
from ...surface.mesh import TriangleMesh
from ...transforms import inverse_rigid, transform_points
from ..landmarks.align_landmarks import complete_landmarks, landmark_arrays
from ..pose_uncertainty import PoseMode, PoseUncertainty
from ..reprojection import jacobian_at

ROUGH_DEG, ROUGH_RELATIVE_DEPTH = 10.0, 0.1
"""How far off a rough pose is taken to be."""

GRID = 32

WIDTH_PX, CORNER_PX = 320, 9
"""Width of the picture, and size of a corner in it; details smaller than that are roughness."""

MOST, WEAKEST, APART_PX = 60, 0.1, 8
"""Corners that are found, the weakest relative to the strongest, and their least distance."""


def next_click(
    points_model: np.ndarray, camera: PinholeCamera, modes: Sequence[PoseMode], click_sigma_px: float
) -> int:
    """Index of the point whose click gains most.

    With one mode: the one that lowers the mean variance of the points' projections most. With several: the one where
    the projections of the two most probable modes differ most, in standard deviations.

    Parameters
    ----------
    points_model
        ``(N, 3)`` points of the visible surface, mm, at least one.
    camera
        Intrinsics of the undistorted frame.
    modes
        The poses that the evidence allows, the most probable first.
    click_sigma_px
        Standard deviation of a click, in each image direction.
    """
    noise = click_sigma_px**2 * np.eye(2)
    if len(modes) > 1:
        seen = [camera.project(transform_points(mode.cam_from_model, points_model)) for mode in modes[:2]]
        spreads = [mode.uncertainty.pixel_covariances(points_model, camera, mode.cam_from_model) for mode in modes[:2]]
        apart = seen[0] - seen[1]
        squared = np.einsum(
            "ni,ni->n", apart, np.linalg.solve(spreads[0] + spreads[1] + noise, apart[..., None])[..., 0]
        )
        return int(np.nanargmax(squared))
    return int(np.argmax(gains_px2(points_model, camera, modes[0], click_sigma_px)))


def gains_px2(points_model: np.ndarray, camera: PinholeCamera, mode: PoseMode, click_sigma_px: float) -> np.ndarray:
    """``(N,)`` px^2: by how much a click at each of ``(N, 3)`` points lowers the mean variance of their projections."""
    covariance = mode.uncertainty.covariance
    jacobians = jacobian_at(points_model, camera, mode.cam_from_model, mode.uncertainty.pivot_model)
    surface = np.einsum("nki,nkj->ij", jacobians, jacobians) / len(points_model)
    across = covariance @ np.swapaxes(jacobians, -1, -2)
    spreads = jacobians @ across + click_sigma_px**2 * np.eye(2)
    lowered = np.swapaxes(across, -1, -2) @ surface @ across
    return np.trace(np.linalg.solve(spreads, lowered), axis1=1, axis2=2)


def visible_points(mesh: TriangleMesh, camera: PinholeCamera, cam_from_model: np.ndarray) -> np.ndarray:
    """``(N, 3)`` points of a surface, mm, seen on a grid of :data:`GRID` pixels across the frame."""
    small = camera.resized(GRID, max(round(GRID * camera.height / camera.width), 1))
    inverse_depth = rasterise_depth(mesh, small, cam_from_model).inverse_depth
    seen = inverse_depth > 0
    points_cam = small.rays_cam(small.pixel_grid())[seen] / inverse_depth[seen][:, None]
    return transform_points(inverse_rigid(cam_from_model), points_cam)


def rough_mode(
    cam_from_model: np.ndarray,
    landmarks: Sequence[Landmark],
    points_model: np.ndarray,
    camera: PinholeCamera,
    click_sigma_px: float,
) -> PoseMode:
    """What a rough pose ``(4, 4)`` and landmarks too few for a pose say together, for the next click.

    The rough pose counts as off by about :data:`ROUGH_DEG` and :data:`ROUGH_RELATIVE_DEPTH` of its distance.
    """
    pivot = points_model.mean(axis=0)
    radius = float(np.sqrt(((points_model - pivot) ** 2).sum(axis=1).mean()))
    pivot_cam = transform_points(cam_from_model, pivot)
    angle = np.radians(ROUGH_DEG)
    shift, depth = angle * radius, ROUGH_RELATIVE_DEPTH * float(np.linalg.norm(pivot_cam))
    precision = np.diag(np.array([shift, shift, depth, angle, angle, angle]) ** -2.0)
    points, _ = landmark_arrays(tuple(complete_landmarks(landmarks).values()))
    jacobian = jacobian_at(points, camera, cam_from_model, pivot).reshape(-1, 6)
    covariance = np.linalg.inv(precision + jacobian.T @ jacobian / click_sigma_px**2)
    uncertainty = PoseUncertainty(pivot, covariance, np.inf, click_sigma_px, radius, pivot_cam)
    return PoseMode(cam_from_model, uncertainty, 1.0, np.ones(len(points), bool))


def corners_in_view(mesh: TriangleMesh, camera: PinholeCamera, cam_from_model: np.ndarray) -> np.ndarray:
    """``(N, 3)`` points of a surface, mm, at the corners of its picture at a pose, the strongest first.

    They are tips and notches of the outline, and where folds meet (Shi & Tomasi, "Good features to track", 1994). Those
    of open borders, where a scan ends, are left out.

    Parameters
    ----------
    mesh
        In the model frame, mm; finer than the picture it only takes longer.
    camera, cam_from_model
        Intrinsics of the undistorted frame, and the pose ``(4, 4)``.
    """
    small = camera.resized(WIDTH_PX, max(round(WIDTH_PX * camera.height / camera.width), 1))
    raster = rasterise_depth(mesh, small, cam_from_model)
    seen = raster.face >= 0
    if not seen.any():
        return np.empty((0, 3))
    rays = small.rays_cam(small.pixel_grid())
    cross = mesh.face_cross[raster.face] @ cam_from_model[:3, :3].T
    lengths = np.linalg.norm(cross, axis=2) * np.linalg.norm(rays, axis=2)
    facing = np.abs((cross * rays).sum(axis=2)) / np.maximum(lengths, 1e-300)
    # where a scan or a crop has cut the surface, the frame shows no corner
    near_border = (seen & _at_border(mesh)[raster.face]).astype(np.uint8)
    inner = 1 - cv2.dilate(near_border, np.ones((CORNER_PX, CORNER_PX), np.uint8))
    picture = cv2.GaussianBlur(np.where(seen, 0.5 + facing, 0.0).astype(np.float32), (0, 0), CORNER_PX / 6)
    corners = cv2.goodFeaturesToTrack(picture, MOST, WEAKEST, APART_PX, mask=inner, blockSize=CORNER_PX)
    if corners is None:
        return np.empty((0, 3))
    # a corner of the outline lies beside the surface: its nearest point
    _, nearest = cv2.distanceTransformWithLabels(
        (~seen).astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_5, labelType=cv2.DIST_LABEL_PIXEL
    )
    pixel_of = np.zeros(int(np.max(nearest)) + 1, np.int64)
    pixel_of[nearest[seen]] = np.flatnonzero(seen)
    x, y = np.rint(corners.reshape(-1, 2)).astype(int).T
    found = pixel_of[nearest[y, x]]
    points_cam = (rays.reshape(-1, 3) / np.where(seen, raster.inverse_depth, 1.0).reshape(-1, 1))[found]
    return transform_points(inverse_rigid(cam_from_model), points_cam)


def _at_border(mesh: TriangleMesh) -> np.ndarray:
    """``(F,)`` bool: the faces with an edge that no other face has."""
    ends = np.sort(mesh.faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1).astype(np.int64)
    _, edge, count = np.unique(ends[:, 0] * len(mesh.vertices) + ends[:, 1], return_inverse=True, return_counts=True)
    return (count[edge.ravel()] == 1).reshape(-1, 3).any(axis=1)
