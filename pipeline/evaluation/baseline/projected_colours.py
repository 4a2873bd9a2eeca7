"""The colours of Zhang & Noble (2024): the frame sampled bilinearly at every vertex, without a test of visibility."""

import numpy as np

from ...camera.pinhole import PinholeCamera
from ...images.pixel_values import sample_bilinear
from ...surface.mesh import TriangleMesh
from ...transforms import transform_points


def projected_colours(
    mesh: TriangleMesh, image: np.ndarray, camera: PinholeCamera, cam_from_model: np.ndarray
) -> np.ndarray:
    """``(V, 3)`` code values 0..1 of all vertices, also of those that are occluded or face away.

    Parameters
    ----------
    mesh
        The surface, model frame, mm.
    image
        ``(H, W, 3)`` code values 0..1 of the frame.
    camera, cam_from_model
        Intrinsics and pose (4x4, mm) of the frame.

    Returns
    -------
    Colours; of a vertex outside the frame that of the nearest pixel of its border, and black behind the camera.
    """
    points_cam = transform_points(cam_from_model, mesh.vertices)
    behind = points_cam[:, 2] <= 0
    pixels = np.nan_to_num(camera.project(points_cam))
    clipped = np.clip(pixels, 0, np.array(camera.size_wh) - 1)
    return np.where(behind[:, None], 0, sample_bilinear(image, clipped)).astype(np.float32)
