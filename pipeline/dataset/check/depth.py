"""Poses against pixels: a view's depth image compared with an independent projection of the surface.

The model's triangles are scan-converted and depth-tested here (:mod:`oneframe.projection.z_buffer`), without Blender
and without its rays. So the comparison tests exactly what the dataset promises: mesh, pose, K, pixel origin, depth
scale and depth image. Needs cv2.
"""

from dataclasses import dataclass

import cv2
import numpy as np

from ...camera.pinhole import PinholeCamera
from ...projection.z_buffer import rasterise_depth
from ...surface.mesh import TriangleMesh

RAY_PX = 0.03
"""Largest distance of a renderer's ray from the pixel's centre, px: on a slope it causes a depth error."""

RELATIVE = 1e-5
"""Allowed relative error of a renderer that computes in single precision."""

LEAST_AGREEING = 0.99
LARGEST_SHIFT_PX = 0.1
"""Of the outline: pixels in only one of the two masks, for each pixel of it."""
PIXELS_OF_ROUNDING = 4
ELSEWHERE = 2e-5
"""Allowed fraction of pixels on unbroken surface whose depths differ: renderers have none, so it is but a margin."""


@dataclass(frozen=True)
class SurfaceDepth:
    """A surface in a view: ``(H, W)`` float64 depth ``z`` in mm at the pixel centres, 0 for none, and ``(2, H, W)``
    float64 ``slope``, its derivatives along u and v in mm/px."""

    z: np.ndarray
    slope: np.ndarray


@dataclass(frozen=True)
class DepthAgreement:
    """How well a depth image and a surface agree.

    Attributes
    ----------
    compared, agreeing
        Number of pixels where both have surface; number of those whose depths agree within rounding, given the slope.
    median_dz_mm
        Median absolute difference there; 0 if nothing is compared.
    only_one, outline
        Number of pixels with surface in only one of the two; number of pixels of the outline.
    elsewhere
        Number of pixels on an unbroken part of the surface whose depths differ by more than twice that rounding.
    """

    compared: int
    agreeing: int
    median_dz_mm: float
    only_one: int
    outline: int
    elsewhere: int

    @property
    def misfit(self) -> str:
        """Disagreements beyond rounding, separated by commas; empty if the view fits."""
        parts = []
        if self.only_one > LARGEST_SHIFT_PX * self.outline + PIXELS_OF_ROUNDING:
            parts.append(f"{self.only_one} px are in only one of the two masks (outline {self.outline} px)")
        if self.agreeing < LEAST_AGREEING * self.compared:
            parts.append(f"only {self.agreeing / self.compared:.1%} of the depths agree")
        if self.elsewhere > PIXELS_OF_ROUNDING + ELSEWHERE * self.compared:
            parts.append(f"the depths of {self.elsewhere} px on unbroken surface differ")
        return ", ".join(parts)


def surface_depth(mesh: TriangleMesh, camera: PinholeCamera, cam_from_model: np.ndarray) -> SurfaceDepth:
    """Depth of a mesh (model frame) at every pixel's centre, of front and back faces."""
    # the inverse depth of a plane n . x = offset is affine in the pixel: n . (rays) / offset
    rotation, translation = cam_from_model[:3, :3], cam_from_model[:3, 3]
    normals = mesh.face_cross @ rotation.T
    offsets = mesh.plane_offsets + normals @ translation
    raster = rasterise_depth(mesh, camera, cam_from_model)
    z, face = raster.depth_mm, raster.face
    gradients = np.divide(
        normals[:, :2], offsets[:, None], out=np.zeros((len(normals), 2)), where=offsets[:, None] != 0
    )
    gradients /= (camera.fx, camera.fy)
    slope = np.where(face >= 0, -(z**2) * np.moveaxis(gradients[face], -1, 0), 0.0)
    return SurfaceDepth(z, slope)


def agreement(
    depth: np.ndarray, depth_scale: float, surface: SurfaceDepth, hidden: np.ndarray | bool = False
) -> DepthAgreement:
    """Compare ``(H, W)`` uint16 depth in units of ``depth_scale`` mm with a surface; where ``hidden``, it has none."""
    seen, expected = depth > 0, surface.z > 0
    both = seen & expected
    z, slope = surface.z[both], surface.slope[:, both]
    dz = depth[both] * depth_scale - z
    per_px = np.abs(slope).sum(axis=0)
    tolerance = 0.5 * depth_scale + RAY_PX * per_px + RELATIVE * z
    outline = expected & (cv2.erode(expected.view(np.uint8), _CROSS, borderType=cv2.BORDER_REPLICATE) == 0)
    return DepthAgreement(
        compared=int(both.sum()),
        agreeing=int((np.abs(dz) <= tolerance).sum()),
        median_dz_mm=float(np.median(np.abs(dz))) if len(dz) else 0.0,
        only_one=int(((seen | hidden) != expected).sum()),
        outline=int(outline.sum()),
        elsewhere=int((_smooth(surface)[both] & (np.abs(dz) > 2 * tolerance)).sum()),
    )


_CROSS = np.array([[0, 1, 0], [1, 1, 1], [0, 1, 0]], np.uint8)


def _smooth(surface: SurfaceDepth) -> np.ndarray:
    """``(H, W)`` bool: pixels that the surface's slopes lead to from all four neighbours: no outline is near."""
    z, steepest = surface.z, np.abs(surface.slope).max(axis=0)
    smooth = z > 0
    for axis in (0, 1):
        one, other = (np.moveaxis(z, axis, 0)[part] for part in (slice(None, -1), slice(1, None)))
        slope = np.moveaxis(steepest, axis, 0)
        reach = 1.5 * np.maximum(slope[:-1], slope[1:]) + RELATIVE * one
        joined = (one > 0) & (other > 0) & (np.abs(one - other) <= reach)
        along = np.moveaxis(smooth, axis, 0)
        along[:-1] &= joined
        along[1:] &= joined
    return smooth
