"""How well the correspondences determine the pose: its covariance, from the click noise."""

from dataclasses import dataclass

import numpy as np

from ...transforms import transform_points
from ..confidence_region import pooled_dof
from ..pose_uncertainty import REGION_LEVEL, PoseUncertainty
from ..reprojection import Correspondences, jacobian_at

SELECTION_PRIOR_DOF = 3.0
"""Degrees of freedom of the prior on the click noise, the stated one, when inliers are selected. The residuals have 2
for each correspondence, less 6."""

REGION_PRIOR_DOF = 0.5
"""The same for the uncertainty of the pose, where a wrong stated noise does more harm. In theory, with clicks twice as
bad as stated, the 95 % region of 4 / 6 / 10 pairs holds the truth in 84 / 93 / 94 % of cases with 0.5, in 77 / 91 /
93 % with 1, in 61 / 83 / 88 % with 3. With less than 0.5 the region of 4 pairs would depend on luck alone."""


@dataclass(frozen=True)
class NoiseEstimate:
    """The click noise, estimated from the stated noise and the residuals together.

    Attributes
    ----------
    variance
        px^2 in each image direction: the scale of the posterior for a scaled inverse chi^2 prior (Gelman et al.,
        Bayesian Data Analysis, 2.6). With few correspondences the stated noise dominates, with many the residuals do.
    residual_dof, prior_dof
        Degrees of freedom of the residuals, and of the stated noise.
    """

    variance: float
    residual_dof: float
    prior_dof: float

    @classmethod
    def of(cls, squared_residuals: float, dof: float, click_sigma_px: float, prior_dof: float) -> "NoiseEstimate":
        """Combine the sum of the squared residuals, px^2, and their degrees of freedom with the stated noise, px."""
        return cls((prior_dof * click_sigma_px**2 + squared_residuals) / (prior_dof + dof), dof, prior_dof)

    @property
    def dof(self) -> float:
        """Degrees of freedom of the posterior, which allows for a wrong stated noise."""
        return self.prior_dof + self.residual_dof

    @property
    def region_dof(self) -> float:
        """Degrees of freedom with which an F distribution gives the right regions if the stated noise is right.

        They hold the truth in 95 % of cases then, see :func:`.confidence_region.pooled_dof`. With :attr:`dof` they
        would be too large: only the residuals make the variance vary.
        """
        return pooled_dof(REGION_LEVEL, 6, self.residual_dof, self.prior_dof) if self.residual_dof else np.inf

    @property
    def sigma_px(self) -> float:
        """Standard deviation in each image direction."""
        return float(np.sqrt(self.variance))


def pose_uncertainty(
    correspondences: Correspondences, cam_from_model: np.ndarray, click_sigma_px: float
) -> PoseUncertainty:
    """Uncertainty of a pose that was fitted to correspondences by least squares.

    The covariance is sigma^2 (J^T J)^-1 with J at the pose and sigma^2 from :class:`NoiseEstimate`. A direction that
    the correspondences do not determine gets a huge standard deviation and raises nothing.

    Parameters
    ----------
    correspondences
        The inliers, about the mean of their points.
    cam_from_model
        ``(4, 4)`` the fitted pose.
    click_sigma_px
        Stated click noise: standard deviation in each image direction.
    """
    points = correspondences.offsets + correspondences.pivot_model
    jacobian = jacobian_at(points, correspondences.camera, cam_from_model, correspondences.pivot_model).reshape(-1, 6)
    points_cam = transform_points(cam_from_model, points)
    squared_px = float(((correspondences.pixels - correspondences.camera.project(points_cam)) ** 2).sum())
    noise = NoiseEstimate.of(squared_px, 2 * len(correspondences) - 6, click_sigma_px, REGION_PRIOR_DOF)
    covariance = noise.variance * inverse_normal_matrix(jacobian)
    return PoseUncertainty(
        pivot_model=correspondences.pivot_model,
        covariance=covariance,
        dof=noise.region_dof,
        sigma_px=noise.sigma_px,
        radius_mm=float(np.sqrt((correspondences.offsets**2).sum(axis=1).mean())),
        pivot_cam=transform_points(cam_from_model, correspondences.pivot_model),
    )


def inverse_normal_matrix(jacobian: np.ndarray) -> np.ndarray:
    """``(M, N)`` J -> ``(N, N)`` (J^T J)^-1, finite also where J is singular.

    The columns are scaled to unit length; singular values below 1e-10 of the largest are raised to that bound.
    """
    scale = np.maximum(np.linalg.norm(jacobian, axis=0), 1e-12)
    _, values, across = np.linalg.svd(jacobian / scale, full_matrices=False)
    values = np.maximum(values, 1e-10 * values[0])
    root = across.T / values / scale[:, None]
    return root @ root.T
