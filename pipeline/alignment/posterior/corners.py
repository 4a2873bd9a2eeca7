"""Places of a surface that a person recognises without colours: corners of its picture, shaded from the lens."""

import cv2
import numpy as np

from ...camera.pinhole import PinholeCamera
from ...projection.z_buffer import rasterise_depth
from ...surface.mesh import TriangleMesh
from ...transforms import inverse_rigid, transform_points

WIDTH_PX, CORNER_PX = 320, 9
"""Width of the picture, and size of a corner in it; details smaller than that are roughness."""

MOST, WEAKEST, APART_PX = 60, 0.1, 8
"""Corners that are found, the weakest relative to the strongest, and their least distance."""


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
