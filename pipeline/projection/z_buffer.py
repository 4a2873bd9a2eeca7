"""A z-buffer of a mesh in a pinhole camera, in numpy: the nearest face at each pixel centre, and its depth.

For interactive work, where starting a renderer would take longer; datasets are ray traced.
"""

from typing import NamedTuple

import numpy as np

from ..camera.pinhole import PinholeCamera
from ..surface.mesh import TriangleMesh
from ..transforms import transform_points
from .rasteriser import rasterise

FARTHEST_PX = 1e5
"""The rasteriser's limit on coordinates."""


class DepthRaster(NamedTuple):
    """The nearest surface at each pixel centre.

    Attributes
    ----------
    inverse_depth
        ``(H, W)`` float64, 1/mm along the optical axis; 0 where there is no surface.
    face
        ``(H, W)`` int64 index of the face, -1 where there is none.
    """

    inverse_depth: np.ndarray
    face: np.ndarray


def rasterise_depth(mesh: TriangleMesh, camera: PinholeCamera, cam_from_model: np.ndarray) -> DepthRaster:
    """Rasterise a mesh, both sides of its faces, and keep the nearest face at each pixel centre.

    Faces with a corner at or behind the plane of the camera centre are left out: there is no near-plane clipping.

    Notes
    -----
    The inverse depth of a plane is affine in the pixel, so interpolation with image barycentrics is exact.
    """
    points = transform_points(cam_from_model, mesh.vertices)
    height, width = camera.shape_hw
    inverse = np.divide(1.0, points[:, 2], out=np.zeros(len(points)), where=points[:, 2] > 0)
    u, v = (
        points[:, axis] * inverse * focal + centre
        for axis, focal, centre in ((0, camera.fx, camera.cx), (1, camera.fy, camera.cy))
    )
    # corner by corner: numpy is slow at reductions along an axis of three
    a, b, c = mesh.faces.T
    kept = np.minimum(np.minimum(inverse[a], inverse[b]), inverse[c]) > 0
    for values, size in ((u, width), (v, height)):
        of_a, of_b, of_c = values[a], values[b], values[c]
        low, high = np.minimum(np.minimum(of_a, of_b), of_c), np.maximum(np.maximum(of_a, of_b), of_c)
        # keep faces with a pixel centre in their bounds, and within the rasteriser's limit on coordinates
        kept &= (
            (np.ceil(low) <= np.floor(high))
            & (high >= 0)
            & (low <= size - 1)
            & (low > -FARTHEST_PX)
            & (high < FARTHEST_PX)
        )
    kept = np.flatnonzero(kept)
    faces = mesh.faces[kept]

    pixel, face, nearness = [], [], []
    for samples in rasterise(np.stack([u[faces], v[faces]], axis=-1)):
        inside = (samples.x >= 0) & (samples.x < width) & (samples.y >= 0) & (samples.y < height)
        triangle = samples.triangle[inside]
        pixel.append(samples.y[inside] * width + samples.x[inside])
        face.append(kept[triangle])
        nearness.append(np.einsum("nk,nk->n", samples.barycentric[inside], inverse[faces[triangle]]))
    inverse_depth, shown = np.zeros(height * width), np.full(height * width, -1)
    if pixel:
        order = np.argsort(np.concatenate(nearness), kind="stable")
        target = np.concatenate(pixel)[order]
        # numpy keeps the last of repeated indices: the nearest
        inverse_depth[target] = np.concatenate(nearness)[order]
        shown[target] = np.concatenate(face)[order]
    return DepthRaster(inverse_depth.reshape(height, width), shown.reshape(height, width))


def is_within_limits(mesh: TriangleMesh, camera: PinholeCamera, cam_from_model: np.ndarray) -> bool:
    """Whether :func:`rasterise_depth` leaves out no face: all are in front of the camera, and not far off the image."""
    points = transform_points(cam_from_model, mesh.vertices)
    # NaN, of points behind the camera, is not within them
    return bool((np.abs(camera.project(points)) < FARTHEST_PX).all())


def inverse_depth_map(depth_mm: np.ndarray, valid: np.ndarray | None = None) -> np.ndarray:
    """``(H, W)`` depth in mm, 0 for background -> inverse depth in 1/mm, 0 also where ``valid`` is False."""
    seen = depth_mm > 0
    if valid is not None:
        seen &= valid
    return np.divide(1.0, depth_mm, out=np.zeros(depth_mm.shape, np.float32), where=seen, casting="same_kind")
