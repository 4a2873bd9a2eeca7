"""The scores that a perfect view could reach, given the photographs' noise, exposure and the error of their poses.

A perfect view is the photograph itself, seen on the true surface. At a pose that is off by some pixels it is the
photograph moved by the field that this error induces, so the photograph's own texture and noise decide what the error
costs. What light and highlights do when the lens moves is not in it: this is a limit from above. Needs ``cv2``.
"""

import cv2
import numpy as np

from ...camera.pinhole import PinholeCamera
from ...transforms import inverse_rigid, rigid, rotation_from_vector, transform_points
from .view_scores import corrected

JITTERS = 4
"""Poses tried for each photograph."""
SAMPLED_POINTS = 2000
ROUNDS = 3


def jittered_pose(
    points_cam: np.ndarray, camera: PinholeCamera, shift_px: float, rng: np.random.Generator
) -> np.ndarray:
    """A random error of a pose, ``moved_from_cam`` (4x4, mm), that displaces the surface by ``shift_px`` (rms).

    Parameters
    ----------
    points_cam
        ``(N, 3)`` points of the surface, mm, in the camera's frame.
    camera
        Intrinsics.
    shift_px
        Root mean square of the displacement in the image.
    rng
        Draws a rotation about the middle of the points and a translation, each of which displaces about as much.
    """
    centre = points_cam.mean(axis=0)
    reach = float(np.sqrt(((points_cam - centre) ** 2).sum(axis=1).mean()))
    turn, shift = rng.normal(size=3), rng.normal(size=3)
    before = camera.project(points_cam)
    # about a pixel to begin with
    size = centre[2] / max(camera.fx, camera.fy)
    moved_from_cam = np.eye(4)
    for _ in range(ROUNDS):
        rotation = rotation_from_vector(turn * size / max(reach, 1e-9))
        moved_from_cam = rigid(translation=centre + shift * size) @ rigid(rotation) @ rigid(translation=-centre)
        after = camera.project(transform_points(moved_from_cam, points_cam))
        reached = float(np.sqrt(np.nanmean(((after - before) ** 2).sum(axis=1))))
        if not reached > 0:
            break
        size *= shift_px / reached
    return moved_from_cam


def perfect_view(
    real: np.ndarray,
    depth_mm: np.ndarray,
    camera: PinholeCamera,
    gain: np.ndarray,
    shift_px: float,
    rng: np.random.Generator,
) -> np.ndarray:
    """The view that a perfect colouring would give, with a pose error.

    Parameters
    ----------
    real
        ``(H, W, 3)`` the photograph, code values 0..1.
    depth_mm
        ``(H, W)`` depth of the surface in it, mm; 0 without surface.
    camera
        Intrinsics.
    gain
        ``(3,)`` factors from views to this photograph, as :func:`.colour_gain` found them: the source frame's exposure.
    shift_px
        Root mean square displacement of the surface.
    rng
        Draws the error.

    Returns
    -------
    ``(H, W, 3)`` code values; black without surface.
    """
    v, u = np.nonzero(depth_mm > 0)
    points = camera.rays_cam(np.stack([u, v], axis=1).astype(float)) * depth_mm[v, u][:, None]
    chosen = points[:: max(len(points) // SAMPLED_POINTS, 1)]
    moved_from_cam = jittered_pose(chosen, camera, shift_px, rng)
    pixels = camera.project(transform_points(inverse_rigid(moved_from_cam), points)).astype(np.float32)
    to_u, to_v = (np.full(depth_mm.shape, -1, np.float32) for _ in range(2))
    to_u[v, u], to_v[v, u] = pixels[:, 0], pixels[:, 1]
    moved = cv2.remap(real, to_u, to_v, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE)
    view = np.where((depth_mm > 0)[..., None], np.clip(moved, 0, 1), 0).astype(np.float32)
    return corrected(view, 1 / gain)
