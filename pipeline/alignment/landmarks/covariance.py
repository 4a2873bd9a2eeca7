"""How well the correspondences determine the pose: covariance, 95 % confidence region and weakest direction."""

from dataclasses import dataclass, replace

import numpy as np

from ...camera.pinhole import PinholeCamera
from ...files.numbers import format_two_digits
from ...transforms import transform_points
from .confidence_region import f_quantile, pooled_dof
from .reprojection import Correspondences, jacobian_at, twist_between

SELECTION_PRIOR_DOF = 3.0
"""Degrees of freedom of the prior on the click noise, the stated one, when inliers are selected. The residuals have 2
for each correspondence, less 6."""

REGION_PRIOR_DOF = 0.5
"""The same for the uncertainty of the pose, where a wrong stated noise does more harm. In theory, with clicks twice as
bad as stated, the 95 % region of 4 / 6 / 10 pairs holds the truth in 84 / 93 / 94 % of cases with 0.5, in 77 / 91 /
93 % with 1, in 61 / 83 / 88 % with 3. With less than 0.5 the region of 4 pairs would depend on luck alone."""

REGION_LEVEL = 0.95

_DIRECTIONS = (
    "shift to the left or right ± {} mm",
    "shift up or down ± {} mm",
    "depth along the view ray ± {} mm",
    "pitch about the image's horizontal axis ± {}°",
    "yaw about the image's vertical axis ± {}°",
    "roll about the view ray ± {}°",
)


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
    residual_dof: int
    prior_dof: float

    @classmethod
    def of(cls, squared_residuals: float, dof: int, click_sigma_px: float, prior_dof: float) -> "NoiseEstimate":
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


@dataclass(frozen=True)
class PoseUncertainty:
    """Covariance of a pose: that of a twist in camera axes about a pivot, see :mod:`.reprojection`.

    Attributes
    ----------
    pivot_model
        ``(3,)`` mean of the points that the pose was fitted to, model frame, mm.
    covariance
        ``(6, 6)`` of (translation in mm, rotation vector in radians), camera axes.
    dof
        Degrees of freedom of the noise estimate, for confidence regions.
    sigma_px
        The noise estimate: standard deviation of a click in each image direction, px. NaN for a pose that does not
        come from clicks.
    radius_mm
        Root mean square distance of these points from the pivot: makes rotations comparable with shifts.
    pivot_cam
        ``(3,)`` the pivot in the camera frame, mm.
    """

    pivot_model: np.ndarray
    covariance: np.ndarray
    dof: float
    sigma_px: float
    radius_mm: float
    pivot_cam: np.ndarray

    @property
    def translation_mm(self) -> np.ndarray:
        """``(3,)`` standard deviations of the pivot's position along the camera's x, y and z, mm."""
        return np.sqrt(np.diag(self.covariance)[:3])

    @property
    def rotation_deg(self) -> np.ndarray:
        """``(3,)`` standard deviations of the rotation about the camera's x, y and z."""
        return np.degrees(np.sqrt(np.diag(self.covariance)[3:]))

    @property
    def largest_rotation_deg(self) -> float:
        """Standard deviation of the rotation about its least certain axis."""
        return float(np.degrees(np.sqrt(np.linalg.eigvalsh(self.covariance[3:, 3:])[-1])))

    @property
    def relative_depth(self) -> float:
        """Standard deviation of the distance along the view ray, relative to the distance."""
        distance = float(np.linalg.norm(self.pivot_cam))
        ray = self.pivot_cam / distance
        return float(np.sqrt(ray @ self.covariance[:3, :3] @ ray)) / distance

    @property
    def weakest_twist(self) -> np.ndarray:
        """``(6,)`` one standard deviation along the least certain direction: there the points move most, in mm.

        The principal eigenvector of the covariance, with rotations multiplied by :attr:`radius_mm`.
        """
        scale = self._scale_to_mm()
        values, vectors = np.linalg.eigh(self.covariance * np.outer(scale, scale))
        # an eigenvector has no sign; a fixed one keeps drawn arrows from jumping
        direction = vectors[:, -1]
        along = self._in_view_axes(direction)
        sign = np.sign(along[np.argmax(np.abs(along))])
        return sign * np.sqrt(values[-1]) * direction / scale

    @property
    def weakest(self) -> str:
        """The name of the largest component of :attr:`weakest_twist`, with that component's standard deviation."""
        scale = self._scale_to_mm()
        along = np.abs(self._in_view_axes(self.weakest_twist * scale))
        number = int(np.argmax(along))
        axes = self._view_axes()
        covariance = axes @ self.covariance @ axes.T
        deviation = np.sqrt(covariance[number, number])
        return _DIRECTIONS[number].format(format_two_digits(deviation if number < 3 else np.degrees(deviation)))

    def scaled(self, factor: float) -> "PoseUncertainty":
        """That of the pose of the surface scaled about the camera's centre: every pixel is as uncertain as before."""
        scale = np.array([factor] * 3 + [1.0] * 3)
        return replace(
            self,
            pivot_model=self.pivot_model * factor,
            covariance=self.covariance * np.outer(scale, scale),
            radius_mm=self.radius_mm * factor,
            pivot_cam=self.pivot_cam * factor,
        )

    def pixel_covariances(
        self, points_model: np.ndarray, camera: PinholeCamera, cam_from_model: np.ndarray
    ) -> np.ndarray:
        """``(N, 2, 2)`` covariances, px^2, of the projections of ``(N, 3)`` model points."""
        jacobians = jacobian_at(points_model, camera, cam_from_model, self.pivot_model)
        return jacobians @ self.covariance @ np.swapaxes(jacobians, -1, -2)

    def ellipse_scale(self, level: float = REGION_LEVEL) -> float:
        """Scale of the ellipse that holds a projected point with probability ``level``, in standard deviations."""
        return float(np.sqrt(2 * f_quantile(level, 2, self.dof)))

    def contains(self, pose: np.ndarray, estimate: np.ndarray, level: float = REGION_LEVEL) -> bool:
        """Whether a pose lies in the confidence region of probability ``level`` around the estimated one.

        Both are ``(4, 4)`` cam_from_model. :meth:`distance` of the true pose follows F(6, dof).
        """
        return self.distance(pose, estimate) <= f_quantile(level, 6, self.dof)

    def distance(self, pose: np.ndarray, estimate: np.ndarray) -> float:
        """d^T C^-1 d / 6, with d the twist from the estimated pose to ``pose`` and C the covariance."""
        scale = self._scale_to_mm()
        twist = twist_between(estimate, pose, self.pivot_model) * scale
        variances, axes = np.linalg.eigh(self.covariance * np.outer(scale, scale))
        # a direction that the pairs do not determine makes the others vanish in rounding: they get a floor
        variances = np.maximum(variances, 1e-15 * variances[-1])
        return float(((axes.T @ twist) ** 2 / variances).sum()) / 6

    def _scale_to_mm(self) -> np.ndarray:
        """``(6,)`` factors that turn a twist into six lengths in mm."""
        return np.array([1.0] * 3 + [self.radius_mm] * 3)

    def _view_axes(self) -> np.ndarray:
        """``(6, 6)`` from camera axes to axes whose third is the view ray and whose first is level in the image."""
        ray = self.pivot_cam / np.linalg.norm(self.pivot_cam)
        right = np.array([1.0, 0, 0]) - ray[0] * ray
        right /= np.linalg.norm(right)
        axes = np.stack([right, np.cross(ray, right), ray])
        return np.block([[axes, np.zeros((3, 3))], [np.zeros((3, 3)), axes]])

    def _in_view_axes(self, twist: np.ndarray) -> np.ndarray:
        return self._view_axes() @ twist


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
    """``(M, 6)`` J -> ``(6, 6)`` (J^T J)^-1, finite also where J is singular.

    The columns are scaled to unit length; singular values below 1e-10 of the largest are raised to that bound.
    """
    scale = np.maximum(np.linalg.norm(jacobian, axis=0), 1e-12)
    _, values, across = np.linalg.svd(jacobian / scale, full_matrices=False)
    values = np.maximum(values, 1e-10 * values[0])
    root = across.T / values / scale[:, None]
    return root @ root.T
