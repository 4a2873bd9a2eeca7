"""Poses against pixels: a view's depth image compared with an independent projection of the surface.

The model's triangles are scan-converted and depth-tested here, in numpy (:mod:`oneframe.projection.z_buffer`), without
Blender and without its rays. So the comparison tests exactly what the dataset promises: mesh, pose, K, pixel origin,
depth scale and depth image. Needs cv2.

Notes
-----
A wrong pose or K shows in two ways, both measured in pixels of the image. Outlines: pixels that belong to only one of
the two masks, divided by the length of the outline. Depths: the least-squares shift d of dz = -grad(z) . d + c z over
all pixels, where dz is the depth image minus the surface. A surface of uniform slope determines only d's component
along the slope (the solution of least norm is taken), and one parallel to the image plane determines nothing.
"""

from dataclasses import dataclass

import cv2
import numpy as np

from ...camera.pinhole import PinholeCamera
from ...projection.z_buffer import is_within_limits, rasterise_depth
from ...surface.mesh import TriangleMesh
from ...transforms import transform_points

GUARD_PX = 64.0
"""Triangles that reach farther out of the image are clipped if some are too far out of it, or behind the camera."""

RAY_PX = 0.03
"""Largest distance of a renderer's ray from the pixel's centre, px: on a slope it causes a depth error."""

RELATIVE = 1e-5
"""Allowed relative error of a renderer that computes in single precision."""

LEAST_AGREEING = 0.99
LARGEST_SHIFT_PX = 0.1
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
    shift_px
        (u, v) shift of the depth image that explains the differences best, as far as the slopes determine it.
    shift_error_px
        Standard error of its length.
    only_one, outline
        Number of pixels with surface in only one of the two; number of pixels of the outline.
    elsewhere
        Number of pixels on an unbroken part of the surface whose depths differ by more than twice that rounding.
    """

    compared: int
    agreeing: int
    median_dz_mm: float
    shift_px: tuple[float, float]
    shift_error_px: float
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
        if np.hypot(*self.shift_px) > LARGEST_SHIFT_PX + 5 * self.shift_error_px:
            parts.append(f"the depths fit best with a shift of ({self.shift_px[0]:+.2f}, {self.shift_px[1]:+.2f}) px")
        return ", ".join(parts)


def surface_depth(mesh: TriangleMesh, camera: PinholeCamera, cam_from_model: np.ndarray) -> SurfaceDepth:
    """Depth of a mesh (model frame) at every pixel's centre, of front and back faces."""
    if not is_within_limits(mesh, camera, cam_from_model):
        mesh, cam_from_model = _in_view(mesh, camera, cam_from_model), np.eye(4)
    if not len(mesh.faces):
        return SurfaceDepth(np.zeros(camera.shape_hw), np.zeros((2, *camera.shape_hw)))
    inverse_depth, face = rasterise_depth(mesh, camera, cam_from_model)
    z = np.divide(1.0, inverse_depth, out=np.zeros_like(inverse_depth), where=face >= 0)
    # the inverse depth of a plane n . x = offset is affine in the pixel: n . (rays) / offset
    rotation, translation = cam_from_model[:3, :3], cam_from_model[:3, 3]
    normals = mesh.face_cross @ rotation.T
    offsets = mesh.plane_offsets + normals @ translation
    gradients = np.divide(
        normals[:, :2], offsets[:, None], out=np.zeros((len(normals), 2)), where=offsets[:, None] != 0
    )
    gradients /= (camera.fx, camera.fy)
    slope = np.where(face >= 0, -(z**2) * np.moveaxis(gradients[face], -1, 0), 0.0)
    return SurfaceDepth(z, slope)


def agreement(
    depth: np.ndarray,
    depth_scale: float,
    surface: SurfaceDepth,
    focal_px: float,
    hidden: np.ndarray | bool = False,
) -> DepthAgreement:
    """Compare ``(H, W)`` uint16 depth in units of ``depth_scale`` mm with a surface; where ``hidden``, it has none."""
    seen, expected = depth > 0, surface.z > 0
    both = seen & expected
    z, slope = surface.z[both], surface.slope[:, both]
    dz = depth[both] * depth_scale - z
    per_px = np.abs(slope).sum(axis=0)
    tolerance = 0.5 * depth_scale + RAY_PX * per_px + RELATIVE * z
    shift, error = _best_shift(dz, slope, tolerance, z / focal_px, near=np.abs(dz) <= tolerance + 2 * per_px)
    outline = expected & (cv2.erode(expected.view(np.uint8), _CROSS, borderType=cv2.BORDER_REPLICATE) == 0)
    return DepthAgreement(
        compared=int(both.sum()),
        agreeing=int((np.abs(dz) <= tolerance).sum()),
        median_dz_mm=float(np.median(np.abs(dz))) if len(dz) else 0.0,
        shift_px=shift,
        shift_error_px=error,
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


def _best_shift(
    dz: np.ndarray, slope: np.ndarray, tolerance: np.ndarray, footprint_mm: np.ndarray, *, near: np.ndarray
) -> tuple[tuple[float, float], float]:
    """Weighted least squares of dz = -slope . shift + c * footprint over the pixels ``near``; shift and its error."""
    if near.sum() < 10:
        return (0.0, 0.0), 0.0
    weight = 1 / tolerance[near]
    rows = np.stack([-slope[0, near], -slope[1, near], footprint_mm[near]], axis=1) * weight[:, None]
    residual = dz[near] * weight
    information = rows.T @ rows
    values, vectors = np.linalg.eigh(information)
    # the depths do not determine a direction in which the slopes hardly vary
    determined = values > 1e-4 * values[-1]
    solution = vectors[:, determined] @ ((vectors[:, determined].T @ (rows.T @ residual)) / values[determined])
    variance = float(np.mean((residual - rows @ solution) ** 2))
    covariance = (vectors[:, determined] * (variance / values[determined])) @ vectors[:, determined].T
    return (float(solution[0]), float(solution[1])), float(np.sqrt(covariance[0, 0] + covariance[1, 1]))


def _in_view(mesh: TriangleMesh, camera: PinholeCamera, cam_from_model: np.ndarray) -> TriangleMesh:
    """The parts of a mesh in front of the camera and near the image, in the camera's frame."""
    points_cam = transform_points(cam_from_model, mesh.vertices)
    triangles = points_cam[mesh.faces]
    offsets = (1e-6 * np.abs(points_cam[:, 2]).max(), 0, 0, 0, 0)
    for plane, offset in zip(_frustum(camera), offsets, strict=True):
        triangles = _clipped(triangles, plane, offset)
    corners = np.arange(3 * len(triangles), dtype=np.int32)
    return TriangleMesh(triangles.reshape(-1, 3), corners.reshape(-1, 3))


def _frustum(camera: PinholeCamera) -> np.ndarray:
    """``(5, 3)`` inward normals of the near plane and of the planes around the image and its guard band."""
    k = camera.k
    low, high_u, high_v = -GUARD_PX, camera.width - 1 + GUARD_PX, camera.height - 1 + GUARD_PX
    u, v, z = k
    return np.stack([z, u - low * z, high_u * z - u, v - low * z, high_v * z - v])


def _clipped(triangles: np.ndarray, plane: np.ndarray, offset: float) -> np.ndarray:
    """``(T, 3, 3)`` triangles -> the triangles of their parts with ``plane . x >= offset`` (Sutherland & Hodgman)."""
    height = triangles @ plane - offset
    inside = height >= 0
    count = inside.sum(axis=1)
    parts = [triangles[count == 3]]
    for kept in (1, 2):
        chosen = count == kept
        # the corner that is alone on its side first
        first = np.argmax(inside[chosen] == (kept == 1), axis=1)
        order = (first[:, None] + np.arange(3)) % 3
        rows = np.arange(len(order))[:, None]
        (a, b, c), h = np.moveaxis(triangles[chosen][rows, order], 1, 0), height[chosen][rows, order]
        ab = a + (b - a) * (h[:, 0] / (h[:, 0] - h[:, 1]))[:, None]
        ac = a + (c - a) * (h[:, 0] / (h[:, 0] - h[:, 2]))[:, None]
        parts += [np.stack([a, ab, ac], 1)] if kept == 1 else [np.stack([ab, b, c], 1), np.stack([ab, c, ac], 1)]
    return np.concatenate(parts)
