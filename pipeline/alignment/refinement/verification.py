"""Verification of a pose against the image: measures that need no ground truth."""

from dataclasses import dataclass

import numpy as np

from ...camera.pinhole import PinholeCamera
from ...transforms import transform_points
from .image_pyramid import PyramidLevel
from .local_search import refine_on_level
from .pose_search import second_peak_ratio
from .shading_features import without_local_mean


@dataclass(frozen=True)
class ImageAgreement:
    """Agreement of a pose with the image.

    Attributes
    ----------
    score
        Fraction, 0..1, of the image's local variation that shading, cavities, outline and colours of the surface
        explain: the squared canonical correlation.
    error_px
        Estimated error: how far in the image, root mean square over the visible surface and in pixels of the full
        image, the surface lies from where the image places it. It includes the uncertainty of that place, see
        :mod:`.jackknife`. NaN if unknown, infinite if the image determines no place.
    """

    score: float
    error_px: float


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
    halves = [refine_on_level(fine, cam_from_model, renderings=1, part=("half", half)) for half in (0, 1)]
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
