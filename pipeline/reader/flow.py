"""Where the surface of one view is in another, and whether it can be seen there."""

import numpy as np

from ..camera.pinhole import PinholeCamera
from ..transforms import transform_points

ROUNDING = 1e-5
"""Allowed relative error of a depth that was computed in single precision."""


def flow(
    points_model: np.ndarray,
    camera: PinholeCamera,
    cam_from_model: np.ndarray,
    depth_mm: np.ndarray,
    rounding_mm: float,
) -> tuple[np.ndarray, np.ndarray]:
    """Optical flow to a view, and what of the surface can be seen in it.

    Parameters
    ----------
    points_model
        ``(H, W, 3)`` points of the surface at the pixels' centres, model frame, mm; NaN where there is none.
    camera, cam_from_model, depth_mm
        Of the other view: intrinsics, pose (4x4, mm) and its ``(h, w)`` depth, 0 where there is no surface.
    rounding_mm
        By which the depths of both may be rounded together.

    Returns
    -------
    ``(H, W, 2)`` float32 px, NaN where there is no surface or it is behind the other camera; and ``(H, W)`` bool.

    Notes
    -----
    A point is hidden if it is farther away than the surface between the four pixels around its place, by more than half
    of what these differ by: no slope hides itself, and beside an outline it counts what has more of the place.
    """
    height, width = points_model.shape[:2]
    points_cam = transform_points(cam_from_model, points_model.reshape(-1, 3).astype(np.float64))
    there = camera.project(points_cam)
    visible = camera.contains(there)
    u, v = there[visible].clip(0, [camera.width - 1, camera.height - 1]).T
    left, top = (np.minimum(at.astype(np.intp), size - 2) for at, size in ((u, camera.width), (v, camera.height)))
    z = points_cam[visible, 2]
    around_mm = np.stack([depth_mm[top + down, left + right] for down in (0, 1) for right in (0, 1)])
    # what shows no surface hides nothing; the inverse depth of a plane is affine in the pixel
    corners = 1.0 / np.where(around_mm > 0, around_mm, z)
    right, down = u - left, v - top
    weights = np.stack([(1 - right) * (1 - down), right * (1 - down), (1 - right) * down, right * down])
    nearer = (weights * corners).sum(axis=0) - (corners.max(axis=0) - corners.min(axis=0)) / 2
    visible[visible] = nearer * (z * (1 - ROUNDING) - rounding_mm) <= 1
    here = np.stack(np.meshgrid(np.arange(width), np.arange(height)), axis=-1)
    return (there.reshape(height, width, 2) - here).astype(np.float32), visible.reshape(height, width)
