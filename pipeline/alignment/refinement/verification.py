"""Verification of a pose against the image: measures that need no ground truth."""

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

DEPTH_EDGE_PX = 4.0
"""Depth step between neighbouring pixels, in pixel footprints, from which it is an edge of the surface."""

EDGE_FRACTION = 0.1
"""Fraction of the pixels, those with the largest gradients, among which edges of the image are sought."""


@dataclass(frozen=True)
class ImageAgreement:
    """Agreement of a pose with the image.

    Attributes
    ----------
    score
        Fraction, 0..1, of the image's local variation that shading, cavities, outline and colours of the surface
        explain: the squared canonical correlation.
    edge_distance_px
        Median distance from the surface's depth edges to the nearest strong edge of the image, in pixels of the full
        image; NaN if surface or image have no such edges.
    """

    score: float
    edge_distance_px: float


@dataclass(frozen=True)
class Verification:
    """Evidence for a refined pose besides its score.

    Attributes
    ----------
    split_half_px
        Mean distance of the visible points between poses refined on two halves of the image, the fields of a
        chequerboard; pixels of the full image, infinite if a half determines no pose.
    second_peak_ratio
        Best score elsewhere in the image over the score at the pose, see :func:`.pose_search.second_peak_ratio`.
    """

    split_half_px: float
    second_peak_ratio: float


def agreement(level: PyramidLevel, cam_from_model: np.ndarray) -> ImageAgreement:
    """Agreement of a ``(4, 4)`` pose with the image of one level."""
    return ImageAgreement(score(level, cam_from_model), _edge_distance_px(level, cam_from_model))


def verify(
    coarse: PyramidLevel,
    fine: PyramidLevel,
    cam_from_model: np.ndarray,
    points_model: np.ndarray,
    camera: PinholeCamera,
) -> Verification:
    """Measure how reliable a refined pose is.

    Parameters
    ----------
    coarse, fine
        Levels for the second peak ratio and for the split-half test.
    cam_from_model
        ``(4, 4)`` the refined pose.
    points_model
        ``(N, 3)`` visible points, mm.
    camera
        Intrinsics of the full image.
    """
    halves = [refine_on_level(fine, cam_from_model, renderings=1, half=half) for half in (0, 1)]
    first, second = (None if half is None else half.cam_from_model for half in halves)
    split_half_px = np.inf if first is None or second is None else mean_distance_px(camera, points_model, first, second)
    return Verification(split_half_px, second_peak_ratio(coarse, cam_from_model))


def contrast(level: PyramidLevel) -> float:
    """Root mean square of the image less its local mean, code values 0..1."""
    detail = without_local_mean(level.image, level.valid, level.window_px)[level.valid]
    return float(np.sqrt(np.mean(detail**2))) if detail.size else 0.0


def mean_distance_px(camera: PinholeCamera, points_model: np.ndarray, a: np.ndarray, b: np.ndarray) -> float:
    """Mean distance between the projections of ``(N, 3)`` points at two poses; infinite if one is behind the camera."""
    seen = [camera.project(transform_points(pose, points_model)) for pose in (a, b)]
    distance = float(np.linalg.norm(seen[0] - seen[1], axis=1).mean())
    return distance if np.isfinite(distance) else np.inf


def _edge_distance_px(level: PyramidLevel, cam_from_model: np.ndarray) -> float:
    inverse_depth = rasterise_depth(level.surface.mesh, level.camera, cam_from_model).inverse_depth
    # a footprint is depth over focal length: steps of the logarithm in units of 1 / f
    logarithm = np.where(inverse_depth > 0, np.log(np.maximum(inverse_depth, 1e-9)), -20.0).astype(np.float32)
    step = cv2.morphologyEx(logarithm, cv2.MORPH_GRADIENT, np.ones((2, 2), np.uint8))
    surface_edges = (step * level.camera.fx > DEPTH_EDGE_PX) & level.valid
    grey = cv2.GaussianBlur(level.image.mean(axis=2), (0, 0), 1.0)
    gradient = np.hypot(cv2.Sobel(grey, cv2.CV_32F, 1, 0), cv2.Sobel(grey, cv2.CV_32F, 0, 1))
    whole = cv2.erode(level.valid.astype(np.uint8), np.ones((5, 5), np.uint8)) > 0
    if not surface_edges.any() or not whole.any():
        return np.nan
    ridge = gradient >= cv2.dilate(gradient, np.ones((3, 3), np.uint8)) * 0.9
    image_edges = ridge & whole & (gradient > max(float(np.quantile(gradient[whole], 1 - EDGE_FRACTION)), 1e-6))
    if not image_edges.any():
        return np.nan
    distance = cv2.distanceTransform((~image_edges).astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    return float(np.median(distance[surface_edges])) * level.px
