"""Verification of a pose against the image: measures that need no ground truth.

Uncertainty of a refined pose: how far it moves if a part of the image is left out (the jackknife, Tukey 1958).

What the features of a surface leave unexplained (albedo, highlights, shadows) is correlated over patches of the image,
so residuals of pixels say too little about the error of the pose. Leaving out patches measures their effect without a
model of their correlation. Patches come in two sizes:

- fields of a chequerboard, one linear step each (the delete-a-group jackknife: Kott, "The delete-a-group jackknife",
  2001): enough of them for the covariance of all six parameters;
- the four quarters, a search each: they also see disagreement that varies slowly over the surface, which fields miss.

The covariance is that of the fields, scaled up to the quarters where these disagree more, and to what an image and a
surface of this coarseness leave in any case. Another error that the whole image shares, such as a search in the wrong
place, remains invisible: that is what the other measures are for.
"""

from dataclasses import dataclass, replace

import numpy as np

from ...camera.pinhole import PinholeCamera
from ...light.local_mean import without_local_mean
from ...transforms import inverse_rigid, transform_points
from ..pose_uncertainty import PoseUncertainty
from .image_pyramid import PyramidLevel
from .local_search import Linearisation, linearised, refine_on_level
from .pose_search import second_peak_ratio

FIELDS = 6
"""Fields along the side of a square with the area of the surface's bounding box in the image."""
QUARTERS = 4
RENDERINGS = 2
"""Renderings of the search without a quarter."""
NOISE, QUARTERS_DOF = 0.7, 2.5
"""Calibrated on 56 refinements of the sample's five views with known poses, under varied light, noise and masks: factor
of the standard deviations, with which the stated error in the median is the true one, and degrees of freedom of a
scale that quarters have set, with which the 95 % region held the truth in 91 %."""
LEAST_LEVEL_PX, LEAST_DOF = 0.1, 8.0
"""Least error in pixels of the level, and its degrees of freedom: the decimated surface and the coarse image draw all
parts of the image alike, which leaving parts out cannot see. Found on 90 refinements of two temporal bones in 30 views,
all but free of other errors."""


@dataclass(frozen=True)
class ImageAgreement:
    """Agreement of a pose with the image.

    Attributes
    ----------
    score
        Fraction, 0..1, of the image's local variation that shading, cavities and outline of the surface explain: the
        squared canonical correlation.
    error_px
        Estimated error: how far in the image, root mean square over the visible surface and in pixels of the full
        image, the surface lies from where the image places it. It includes the uncertainty of that place, see
        :func:`jackknife`. NaN if unknown, infinite if the image determines no place.
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


def jackknife(
    level: PyramidLevel, cam_from_model: np.ndarray, points_model: np.ndarray, camera: PinholeCamera
) -> PoseUncertainty | None:
    """Uncertainty of a refined pose.

    Parameters
    ----------
    level
        The finest level.
    cam_from_model
        ``(4, 4)`` the refined pose.
    points_model
        ``(N, 3)`` visible points, mm.
    camera
        Intrinsics of the full image.

    Returns
    -------
    The uncertainty; ``None`` if too little of the surface is in the image, or if a part of it determines no pose.
    """
    system = linearised(level, cam_from_model)
    covariance, count = (None, 0) if system is None else _field_covariance(system)
    if system is None or covariance is None:
        return None
    pivot_model = transform_points(inverse_rigid(cam_from_model), system.pivot_cam)
    uncertainty = PoseUncertainty(
        pivot_model=pivot_model,
        covariance=covariance,
        dof=float(count - 1),
        sigma_px=np.nan,
        radius_mm=float(np.sqrt(((points_model - pivot_model) ** 2).sum(axis=1).mean())),
        pivot_cam=system.pivot_cam,
    )
    squared_px = 0.0
    for quarter in range(QUARTERS):
        found = refine_on_level(level, cam_from_model, renderings=RENDERINGS, part=("without quarter", quarter))
        if found is None:
            return None
        moved = camera.project(transform_points(found.cam_from_model, points_model))
        moved -= camera.project(transform_points(cam_from_model, points_model))
        squared_px += float((moved**2).sum(axis=1).mean())
    quarters_px = NOISE * np.sqrt((QUARTERS - 1) / QUARTERS * squared_px)
    fields_px = max(uncertainty.root_mean_square_px(points_model, camera, cam_from_model), 1e-12)
    if not np.isfinite(quarters_px / fields_px):
        return None
    own_px, least_px = max(fields_px, quarters_px), LEAST_LEVEL_PX * level.px
    dof = uncertainty.dof if fields_px >= quarters_px else QUARTERS_DOF
    if own_px < least_px:
        own_px, dof = least_px, min(dof, LEAST_DOF)
    return replace(uncertainty, covariance=(own_px / fields_px) ** 2 * covariance, dof=dof)


def _field_covariance(system: Linearisation) -> tuple[np.ndarray | None, int]:
    """``(6, 6)`` covariance of the twist, ``None`` if the fields determine none, and the number of fields."""
    side = max(float(np.sqrt(np.prod(np.ptp(system.pixels, axis=0)))) / FIELDS, 2.0)
    fields, field = np.unique((system.pixels // side).astype(int), axis=0, return_inverse=True)
    field = field.ravel()  # numpy 2.0 gave it the shape of the input
    count = len(fields)
    normals, gradients = np.zeros((count, 6, 6)), np.zeros((count, 6))
    np.add.at(normals, field, system.jacobian[:, :, None] * system.jacobian[:, None, :])
    np.add.at(gradients, field, system.jacobian * system.residuals[:, None])
    normal, gradient = normals.sum(axis=0), gradients.sum(axis=0)
    # mm and radians differ in size: each parameter in units of its own curvature
    scale = np.sqrt(np.maximum(np.diag(normal), 1e-300))
    rest = (normal - normals) / np.outer(scale, scale) + 1e-9 * np.eye(6)
    try:
        step = np.linalg.solve(normal / np.outer(scale, scale) + 1e-9 * np.eye(6), gradient / scale)
        steps = np.linalg.solve(rest, ((gradient - gradients) / scale)[..., None])[..., 0] - step
    except np.linalg.LinAlgError:
        return None, count
    covariance = NOISE**2 * (count - 1) / count * steps.T @ steps / np.outer(scale, scale)
    return (covariance if np.isfinite(covariance).all() else None), count
