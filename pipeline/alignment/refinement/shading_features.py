"""Features of a surface that predict the shading of a photograph: images rendered from the mesh at a pose.

Under a light next to the lens, as in an endoscope or a surgical microscope, surface is bright where it faces the lens
and dark in cavities. How bright, and in which colour, is left open: :mod:`.canonical_correlation` finds the linear
combination of features that correlates best with the image.

Notes
-----
To first order, diffuse light is linear in the normal (Basri & Jacobs, "Lambertian reflectance and linear subspaces",
2003). Depth relative to the surroundings models shadowing and interreflection (Luft et
al., "Image enhancement by unsharp masking the depth buffer", 2006). The region includes a rim of background around the
outline, with one feature, the mask of the surface: so the outline counts where the surface differs in colour from its
background.
"""

from dataclasses import dataclass

import cv2
import numpy as np

from ...camera.pinhole import PinholeCamera
from ...light.local_mean import without_local_mean
from ...projection.z_buffer import rasterise_depth
from ...surface.mesh import TriangleMesh
from ...transforms import inverse_rigid, transform_points

RIM = 0.1
"""Width of the rim relative to the square root of the surface's area in the image."""


@dataclass(frozen=True)
class Appearance:
    """Features of a surface at a pose.

    Attributes
    ----------
    region
        ``(H, W)`` bool: the surface and its rim.
    features
        ``(H, W, K)`` float32, without their local mean; 0 outside the region.
    points_model
        ``(H, W, 3)`` the points that the pixels show, mm; pixels of the rim have the depth of the nearest surface.
    """

    region: np.ndarray
    features: np.ndarray
    points_model: np.ndarray


def appearance(
    mesh: TriangleMesh,
    camera: PinholeCamera,
    cam_from_model: np.ndarray,
    *,
    window_px: float,
    brief: bool = False,
) -> Appearance | None:
    """Features of a surface at a pose, or ``None`` if fewer than 16 pixels show it.

    Parameters
    ----------
    mesh
        The surface, model frame, mm.
    camera, cam_from_model
        Intrinsics, and ``(4, 4)`` pose.
    window_px
        Standard deviation of the Gaussian window of local means, see :func:`without_local_mean`.
    brief
        Few features, and only such that do not change with a rotation about the optical axis.
    """
    raster = rasterise_depth(mesh, camera, cam_from_model)
    seen = raster.face >= 0
    if np.count_nonzero(seen) < 16:
        return None
    inverse_depth, region = _with_rim(raster.inverse_depth, seen)
    rays = camera.rays_cam(camera.pixel_grid())
    depth = np.divide(1.0, inverse_depth, out=np.zeros_like(inverse_depth), where=region)
    points_cam = rays * depth[..., None]

    cross = mesh.face_cross @ cam_from_model[:3, :3].T
    normals = cross / np.maximum(np.linalg.norm(cross, axis=1, keepdims=True), 1e-300)
    normal = np.where(seen[..., None], normals[raster.face], 0.0)
    towards_lens = -(normal * rays).sum(axis=2) / np.linalg.norm(rays, axis=2)
    # the visible side of a face counts as its front
    normal *= np.sign(towards_lens)[..., None]

    # depth in pixels, so that its steps are comparable with the window at any scale
    relief = (depth * np.median(camera.fx * inverse_depth[seen])).astype(np.float32)
    fine = without_local_mean(relief, region, window_px / 4)
    features = [np.abs(towards_lens), relief, np.maximum(fine, 0)]
    if not brief:
        features += [fine, np.maximum(without_local_mean(relief, region, window_px), 0), normal[..., 0], normal[..., 1]]
    if (region != seen).any():
        features.append(seen)
    stack = np.dstack([feature.astype(np.float32) for feature in features])
    points_model = transform_points(inverse_rigid(cam_from_model), points_cam.reshape(-1, 3)).reshape(points_cam.shape)
    return Appearance(region, without_local_mean(stack, region, window_px), points_model)


def _with_rim(inverse_depth: np.ndarray, seen: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Extend the depth beyond the outline by the rim: inverse depth and region, both ``(H, W)``."""
    if seen.all():
        return inverse_depth, seen
    distance, label = cv2.distanceTransformWithLabels(
        (~seen).astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_5, labelType=cv2.DIST_LABEL_PIXEL
    )
    region = distance <= max(RIM * np.sqrt(np.count_nonzero(seen)), 2.0)
    # every pixel of the surface has a unique label, which the background pixels nearest to it share
    of_label = np.zeros(int(np.max(label)) + 1)
    of_label[label[seen]] = inverse_depth[seen]
    return np.where(region, of_label[label], 0.0), region
