"""The scores that a perfect view could reach, given the photographs' noise, exposure and the error of their poses.

A perfect view is the photograph itself, seen on the true surface. At a pose that is off by some pixels it is the
photograph moved by the field that this error induces, so the photograph's own texture and noise decide what the error
costs. What light and highlights do when the lens moves is not in it: this is a limit from above. Needs ``cv2``.
"""

from collections.abc import Iterator, Sequence

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


def perfect_views(
    real: np.ndarray,
    depth_mm: np.ndarray,
    camera: PinholeCamera,
    gain: np.ndarray,
    shift_px: float,
    rngs: Sequence[np.random.Generator],
) -> Iterator[np.ndarray]:
    """The views that a perfect colouring would give, with errors of the pose.

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
    rngs
        Each draws an error.

    Yields
    ------
    ``(H, W, 3)`` code values for each error; black without surface.
    """
    surface = depth_mm > 0
    nearness = np.divide(1, depth_mm, out=np.zeros(depth_mm.shape), where=surface)
    v, u = np.nonzero(surface)
    every = slice(None, None, max(len(u) // SAMPLED_POINTS, 1))
    chosen = camera.rays_cam(np.stack([u[every], v[every]], axis=1).astype(float)) * depth_mm[v, u][every, None]
    rows, columns = np.ogrid[: camera.height, : camera.width]
    for rng in rngs:
        cam_from_moved = inverse_rigid(jittered_pose(chosen, camera, shift_px, rng))
        # of a pixel (u, v, 1) with its nearness: the pixel that it shows, times the relative depth
        there, shift = camera.k @ cam_from_moved[:3, :3] @ np.linalg.inv(camera.k), camera.k @ cam_from_moved[:3, 3]
        x, y, z = (a * columns + (b * rows + c) + s * nearness for (a, b, c), s in zip(there, shift, strict=True))
        to_u, to_v = (np.where(surface, each / z, -1).astype(np.float32) for each in (x, y))
        moved = cv2.remap(real, to_u, to_v, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE)
        moved[~surface] = 0
        yield corrected(np.clip(moved, 0, 1, out=moved), 1 / gain)
