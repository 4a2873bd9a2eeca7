"""Where points lie that a camera does not show, in words."""

import numpy as np

from ..transforms import transform_points
from .pinhole import PinholeCamera


def whereabouts(points: np.ndarray, camera: PinholeCamera, cam_from_points: np.ndarray) -> str | None:
    """Which side of the image points are on, e.g. ``"left of the frame and below it"``.

    Parameters
    ----------
    points
        ``(N, 3)`` mm.
    camera, cam_from_points
        Intrinsics and pose (4x4, mm).

    Returns
    -------
    ``None`` if the bounds of those in front of the camera reach into the image.
    """
    points_cam = transform_points(cam_from_points, points)
    points_cam = points_cam[points_cam[:, 2] > 0]
    if len(points_cam) == 0:
        return "behind the camera"
    u, v = camera.project(points_cam).T
    sides = (
        (u.max() < -0.5, "left of"), (u.min() > camera.width - 0.5, "right of"),
        (v.max() < -0.5, "above"), (v.min() > camera.height - 0.5, "below"),
    )  # fmt: skip
    words = [word for beyond, word in sides if beyond]
    if not words:
        return None
    return " and ".join([f"{words[0]} the frame", *(f"{word} it" for word in words[1:])])
