"""How well a pose and an image agree, in numbers that can be judged without knowing the true pose."""

from dataclasses import dataclass

import cv2
import numpy as np

from ...camera.pinhole import PinholeCamera
from ...projection.z_buffer import rasterise_depth
from ...transforms import transform_points
from .image_pyramid import PyramidLevel
from .local_search import refine_on_level, score
from .pose_search import second_peak_ratio
from .shading_features import without_local_mean

STEP_PX = 4.0
"""Depth steps of more pixel footprints than this between neighbours are edges of the surface."""
CANNY_SHARE = 0.1
"""Share of the image's pixels that count as edges: those with the steepest brightness."""


@dataclass(frozen=True)
class ImageAgreement:
    """A pose against the image.

    Attributes
    ----------
    score
        Share (0..1) of the image's local variation that the shape's shading, cavities, outline and colours explain
        there: the squared canonical correlation.
    edge_distance_px
        Median distance from the surface's depth edges to the nearest strong edge of the image, in pixels of the full
        image; NaN if the surface shows no edges there.
    """

    score: float
    edge_distance_px: float


@dataclass(frozen=True)
class Verification:
    """What speaks for a refined pose, beside its score.

    Attributes
    ----------
    halves_px
        Mean distance between the visible points as two halves of the image, the fields of a chequerboard, would
        place them on their own; pixels of the full image.
    rivalry
        How well the same rendering fits elsewhere in the image, over how well it fits here.
    """

    split_half_px: float
    second_peak_ratio: float


def agreement(level: PyramidLevel, cam_from_model: np.ndarray) -> ImageAgreement:
    """Measure a pose on one level."""
    return ImageAgreement(score(level, cam_from_model), _edge_distance_px(level, cam_from_model))


def verify(
    coarse: PyramidLevel,
    fine: PyramidLevel,
    cam_from_model: np.ndarray,
    points_model: np.ndarray,
    camera: PinholeCamera,
) -> Verification:
    """Test a refined pose; ``points_model`` (N, 3) are visible points, ``camera`` that of the full image."""
    halves = [refine_on_level(fine, cam_from_model, renderings=1, half=half) for half in (0, 1)]
    first, second = (None if half is None else half.cam_from_model for half in halves)
    apart = np.inf if first is None or second is None else mean_distance_px(camera, points_model, first, second)
    return Verification(apart, second_peak_ratio(coarse, cam_from_model))


def contrast(level: PyramidLevel) -> float:
    """Root mean square of the image less its local mean, code values 0..1."""
    detail = without_local_mean(level.image, level.valid, level.window_px)[level.valid]
    return float(np.sqrt(np.mean(detail**2))) if detail.size else 0.0


def mean_distance_px(camera: PinholeCamera, points_model: np.ndarray, a: np.ndarray, b: np.ndarray) -> float:
    """Mean distance between the images of ``(N, 3)`` points in two poses; infinite if they are behind the camera."""
    seen = [camera.project(transform_points(pose, points_model)) for pose in (a, b)]
    distance = float(np.linalg.norm(seen[0] - seen[1], axis=1).mean())
    return distance if np.isfinite(distance) else np.inf


def _edge_distance_px(level: PyramidLevel, cam_from_model: np.ndarray) -> float:
    inverse_depth = rasterise_depth(level.surface.mesh, level.camera, cam_from_model).inverse_depth
    # a footprint is depth over focal length: steps of the logarithm in units of 1 / f
    logarithm = np.where(inverse_depth > 0, np.log(np.maximum(inverse_depth, 1e-9)), -20.0).astype(np.float32)
    step = cv2.morphologyEx(logarithm, cv2.MORPH_GRADIENT, np.ones((2, 2), np.uint8))
    surface_edges = (step * level.camera.fx > STEP_PX) & level.valid
    grey = cv2.GaussianBlur(level.image.mean(axis=2), (0, 0), 1.0)
    slope = np.hypot(cv2.Sobel(grey, cv2.CV_32F, 1, 0), cv2.Sobel(grey, cv2.CV_32F, 0, 1))
    whole = cv2.erode(level.valid.astype(np.uint8), np.ones((5, 5), np.uint8)) > 0
    if not surface_edges.any() or not whole.any():
        return np.nan
    ridge = slope >= cv2.dilate(slope, np.ones((3, 3), np.uint8)) * 0.9
    image_edges = ridge & whole & (slope > max(float(np.quantile(slope[whole], 1 - CANNY_SHARE)), 1e-6))
    if not image_edges.any():
        return np.nan
    distance = cv2.distanceTransform((~image_edges).astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    return float(np.median(distance[surface_edges])) * level.px
