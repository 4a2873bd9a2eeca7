"""What geometry foretells of a photograph: features of a mesh in a view, each a picture that brightness may follow.

Under light beside the lens, as of an endoscope or a surgical microscope, surface is bright where it faces the lens and
dark in cavities. How bright, and in which colour, is left open: :mod:`.canonical_correlation` finds the mixture of
features that the image follows best.

Notes
-----
To first order, diffuse light is linear in the normal (Basri & Jacobs, "Lambertian reflectance and linear subspaces",
2003); depth below the surroundings stands for shadowing and interreflection (Luft et al., "Image enhancement by
unsharp masking the depth buffer", 2006). Around the outline lies a rim of background, which takes part with one
feature, "this is the object": a colour that sets it off from its background makes its outline count.
"""

from dataclasses import dataclass

import cv2
import numpy as np

from ...camera.pinhole import PinholeCamera
from ...projection.z_buffer import rasterise_depth
from ...surface.mesh import TriangleMesh
from ...transforms import inverse_rigid, transform_points

RIM = 0.1
"""Width of the rim over the square root of the outline's area."""

LARGEST_DEVIATION = 3.0
"""From the local mean of an image, in standard deviations."""


@dataclass(frozen=True)
class Surface:
    """A mesh with optional ``(V, 3)`` vertex colours (0..1), model frame."""

    mesh: TriangleMesh
    colours: np.ndarray | None = None


@dataclass(frozen=True)
class Appearance:
    """Features of a surface in a view.

    Attributes
    ----------
    region
        ``(H, W)`` bool: the surface and its rim.
    features
        ``(H, W, K)`` float32, without their local mean; 0 outside the region.
    points_model
        ``(H, W, 3)`` the points that the pixels show, mm; a pixel of the rim takes the depth of the nearest surface.
    """

    region: np.ndarray
    features: np.ndarray
    points_model: np.ndarray


def appearance(
    surface: Surface,
    camera: PinholeCamera,
    cam_from_model: np.ndarray,
    *,
    window_px: float,
    brief: bool = False,
) -> Appearance | None:
    """Features of a surface in a view, or ``None`` if fewer than 16 pixels show it.

    Parameters
    ----------
    window_px
        Standard deviation of the Gaussian window of local means, see :func:`without_local_mean`.
    brief
        Only the features that are the same after a turn about the view ray, and few of them.
    """
    raster = rasterise_depth(surface.mesh, camera, cam_from_model)
    seen = raster.face >= 0
    if np.count_nonzero(seen) < 16:
        return None
    inverse_depth, region = _with_rim(raster.inverse_depth, seen)
    rays = camera.rays_cam(camera.pixel_grid())
    depth = np.divide(1.0, inverse_depth, out=np.zeros_like(inverse_depth), where=region)
    points_cam = rays * depth[..., None]

    mesh = surface.mesh
    cross = mesh.face_cross @ cam_from_model[:3, :3].T
    normals = cross / np.maximum(np.linalg.norm(cross, axis=1, keepdims=True), 1e-300)
    normal = np.where(seen[..., None], normals[raster.face], 0.0)
    towards_lens = -(normal * rays).sum(axis=2) / np.linalg.norm(rays, axis=2)
    # either side of a face may be its front: the one that is seen
    normal *= np.sign(towards_lens)[..., None]

    # depth in pixels: then its steps have the size of their shadows whatever the scale
    relief = (depth * np.median(camera.fx * inverse_depth[seen])).astype(np.float32)
    fine = without_local_mean(relief, region, window_px / 4)
    features = [np.abs(towards_lens)]
    if not brief or surface.colours is None:
        features += [relief, np.maximum(fine, 0)]
    if not brief:
        features += [fine, np.maximum(without_local_mean(relief, region, window_px), 0), normal[..., 0], normal[..., 1]]
    if surface.colours is not None:
        colours = surface.colours[mesh.faces].mean(axis=1)
        features += list(np.moveaxis(np.where(seen[..., None], colours[raster.face], 0.0), 2, 0))
    if (region != seen).any():
        features.append(seen)
    stack = np.dstack([feature.astype(np.float32) for feature in features])
    points_model = transform_points(inverse_rigid(cam_from_model), points_cam.reshape(-1, 3)).reshape(points_cam.shape)
    return Appearance(region, without_local_mean(stack, region, window_px), points_model)


def without_local_mean(image: np.ndarray, mask: np.ndarray, window_px: float) -> np.ndarray:
    """``(H, W)`` or ``(H, W, C)`` less its Gaussian-weighted mean over the mask; float32, 0 outside the mask.

    The weights are those of the mask's pixels only (normalised convolution, Knutsson & Westin 1993).
    """
    result = _minus_local_mean(image, mask, window_px)
    result[~mask] = 0
    return result


def image_without_local_mean(image: np.ndarray, valid: np.ndarray, mask: np.ndarray, window_px: float) -> np.ndarray:
    """The image ``(H, W, C)`` less its mean over ``mask & valid``, also beyond the mask; 0 outside ``valid``.

    Values are held to :data:`LARGEST_DEVIATION`, so that highlights and instruments have no more say than that.
    """
    result = _minus_local_mean(image, mask & valid, window_px)
    result[~valid] = 0
    spread = np.sqrt(np.mean(result[mask & valid] ** 2, axis=0)) if (mask & valid).any() else 0.0
    return np.clip(result, -LARGEST_DEVIATION * spread, LARGEST_DEVIATION * spread).astype(np.float32)


def _minus_local_mean(image: np.ndarray, mask: np.ndarray, window_px: float) -> np.ndarray:
    weight = mask.astype(np.float32)
    total = np.maximum(cv2.GaussianBlur(weight, (0, 0), window_px, borderType=cv2.BORDER_CONSTANT), 1e-6)
    planes = image.astype(np.float32).reshape(*image.shape[:2], -1)
    mean = [
        cv2.GaussianBlur(plane * weight, (0, 0), window_px, borderType=cv2.BORDER_CONSTANT) / total
        for plane in np.moveaxis(planes, 2, 0)
    ]
    return (planes - np.dstack(mean)).reshape(image.shape)


def _with_rim(inverse_depth: np.ndarray, seen: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Continue the depth a little beyond the outline: inverse depth and region, both ``(H, W)``."""
    if seen.all():
        return inverse_depth, seen
    distance, label = cv2.distanceTransformWithLabels(
        (~seen).astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_5, labelType=cv2.DIST_LABEL_PIXEL
    )
    region = distance <= max(RIM * np.sqrt(np.count_nonzero(seen)), 2.0)
    # every pixel of the surface has a label of its own, which its nearest background pixels share
    of_label = np.zeros(int(np.max(label)) + 1)
    of_label[label[seen]] = inverse_depth[seen]
    return np.where(region, of_label[label], 0.0), region
