"""How well the pairs determine the pose: covariance, 95 % region and weakest direction."""

from dataclasses import dataclass

import numpy as np

from ...camera.pinhole import PinholeCamera
from ...files.numbers import format_two_digits
from ...transforms import transform_points
from .confidence_region import f_quantile
from .reprojection import Correspondences, jacobian_at, twist_between

PRIOR_DOF = 3.0
"""What the stated click noise counts for, in degrees of freedom, against the residuals (2 for a pair, less 6)."""

_FREEDOMS = (
    "shift to the left or right ± {} mm",
    "shift up or down ± {} mm",
    "depth along the view ray ± {} mm",
    "tilt about the image's horizontal axis ± {}°",
    "turn about the image's vertical axis ± {}°",
    "roll about the view ray ± {}°",
)


@dataclass(frozen=True)
class NoiseEstimate:
    """The noise of a click, from the stated one and the residuals together.

    Attributes
    ----------
    variance
        px^2 in each image direction: the scale of the posterior, for a scaled inverse chi^2 prior (Gelman et al.,
        Bayesian Data Analysis, 2.6). With few pairs the residuals say next to nothing and the stated noise holds; with
        many they overrule it.
    dof
        Degrees of freedom of that posterior, which allows for a stated noise that is wrong.
    effective_dof
        Degrees of freedom with which the variance scatters where the stated noise is right (Satterthwaite 1946): only
        the residuals do. With it a 95 % region holds the truth 95 times in a hundred, instead of nearly always.
    """

    variance: float
    dof: float
    effective_dof: float

    @classmethod
    def of(cls, squared_residuals: float, dof: int, click_sigma_px: float) -> "NoiseEstimate":
        """From the sum of the squared residuals, px^2, and their degrees of freedom."""
        total = PRIOR_DOF + dof
        variance = (PRIOR_DOF * click_sigma_px**2 + squared_residuals) / total
        return cls(variance, total, total**2 / dof if dof else np.inf)

    @property
    def sigma_px(self) -> float:
        """Standard deviation."""
        return float(np.sqrt(self.variance))


@dataclass(frozen=True)
class PoseUncertainty:
    """Covariance of a pose, as that of a twist in camera axes about a pivot; see :mod:`pipeline.transforms`.

    Attributes
    ----------
    pivot_model
        ``(3,)`` mean of the points that the pose was fitted to, mm.
    covariance
        ``(6, 6)`` of (translation mm, rotation radians) along the axes of the camera.
    dof
        Degrees of freedom of the noise estimate in it, for regions of a stated probability.
    sigma_px
        The noise estimate: standard deviation of a click in each image direction.
    radius_mm
        Root mean square distance of these points from the pivot: makes turns comparable with shifts.
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
        """``(3,)`` standard deviations of the pivot's position along the camera's x, y, z."""
        return np.sqrt(np.diag(self.covariance)[:3])

    @property
    def rotation_deg(self) -> np.ndarray:
        """``(3,)`` standard deviations of the rotation about the camera's x, y, z."""
        return np.degrees(np.sqrt(np.diag(self.covariance)[3:]))

    @property
    def largest_rotation_deg(self) -> float:
        """Standard deviation of the rotation about the axis about which it is known worst."""
        return float(np.degrees(np.sqrt(np.linalg.eigvalsh(self.covariance[3:, 3:])[-1])))

    @property
    def relative_depth(self) -> float:
        """Standard deviation of the distance along the view ray, relative to the distance."""
        distance = float(np.linalg.norm(self.pivot_cam))
        ray = self.pivot_cam / distance
        return float(np.sqrt(ray @ self.covariance[:3, :3] @ ray)) / distance

    @property
    def weakest_twist(self) -> np.ndarray:
        """``(6,)`` one standard deviation of the direction that is known worst: along it the points move most, in mm.

        The largest eigenvector of the covariance after the rotations are multiplied by :attr:`radius_mm`.
        """
        scale = self._common_measure()
        values, vectors = np.linalg.eigh(self.covariance * np.outer(scale, scale))
        # the sign that moves away from the camera, or else to larger coordinates: drawn arrows do not jump
        direction = vectors[:, -1]
        along = self._in_view_axes(direction)
        sign = np.sign(along[np.argmax(np.abs(along))])
        return sign * np.sqrt(values[-1]) * direction / scale

    @property
    def weakest(self) -> str:
        """The weakest direction in words, with its standard deviation; of a mixture, the largest component."""
        scale = self._common_measure()
        along = np.abs(self._in_view_axes(self.weakest_twist * scale))
        number = int(np.argmax(along))
        axes = self._view_axes()
        covariance = axes @ self.covariance @ axes.T
        deviation = np.sqrt(covariance[number, number])
        return _FREEDOMS[number].format(format_two_digits(deviation if number < 3 else np.degrees(deviation)))

    def pixel_covariances(
        self, points_model: np.ndarray, camera: PinholeCamera, cam_from_model: np.ndarray
    ) -> np.ndarray:
        """``(N, 2, 2)`` px^2: how uncertain the pose leaves the pixels of ``(N, 3)`` points of the model."""
        jacobians = jacobian_at(points_model, camera, cam_from_model, self.pivot_model)
        return jacobians @ self.covariance @ np.swapaxes(jacobians, -1, -2)

    def ellipse_scale(self, level: float = 0.95) -> float:
        """Semi-axes of the region that holds a pixel with this probability, in standard deviations."""
        return float(np.sqrt(2 * f_quantile(level, 2, self.dof)))

    def contains(self, pose: np.ndarray, estimate: np.ndarray, level: float = 0.95) -> bool:
        """Whether a pose lies in the region around the estimated one that holds the true pose with probability level.

        Both are ``(4, 4)`` cam_from_model. d^T C^-1 d / 6 of the twist d between them follows F(6, dof).
        """
        return self.distance(pose, estimate) <= f_quantile(level, 6, self.dof)

    def distance(self, pose: np.ndarray, estimate: np.ndarray) -> float:
        """d^T C^-1 d / 6 of the twist d from the estimated pose to another."""
        scale = self._common_measure()
        twist = twist_between(estimate, pose, self.pivot_model) * scale
        return float(twist @ np.linalg.solve(self.covariance * np.outer(scale, scale), twist)) / 6

    def _common_measure(self) -> np.ndarray:
        return np.array([1.0] * 3 + [self.radius_mm] * 3)

    def _view_axes(self) -> np.ndarray:
        """``(6, 6)`` from camera axes to axes whose third is the view ray; the first stays level in the image."""
        ray = self.pivot_cam / np.linalg.norm(self.pivot_cam)
        right = np.array([1.0, 0, 0]) - ray[0] * ray
        right /= np.linalg.norm(right)
        axes = np.stack([right, np.cross(ray, right), ray])
        return np.block([[axes, np.zeros((3, 3))], [np.zeros((3, 3)), axes]])

    def _in_view_axes(self, twist: np.ndarray) -> np.ndarray:
        return self._view_axes() @ twist


def pose_uncertainty(pairs: Correspondences, cam_from_model: np.ndarray, click_sigma_px: float) -> PoseUncertainty:
    """Uncertainty of a pose that was fitted to pairs by least squares.

    sigma^2 (J^T J)^-1 with J at the pose and sigma^2 from :class:`NoiseEstimate`. What the pairs do not determine at
    all comes out as an enormous deviation, never as an error.

    Parameters
    ----------
    pairs
        The pairs that took part, about the mean of their points.
    cam_from_model
        The fitted pose.
    click_sigma_px
        Stated standard deviation of a click in each image direction.
    """
    points = pairs.offsets + pairs.pivot_model
    jacobian = jacobian_at(points, pairs.camera, cam_from_model, pairs.pivot_model).reshape(-1, 6)
    points_cam = transform_points(cam_from_model, points)
    squared = float(((pairs.pixels - pairs.camera.project(points_cam)) ** 2).sum())
    noise = NoiseEstimate.of(squared, 2 * len(pairs) - 6, click_sigma_px)
    covariance = noise.variance * inverse_normal(jacobian)
    return PoseUncertainty(
        pivot_model=pairs.pivot_model,
        covariance=covariance,
        dof=noise.effective_dof,
        sigma_px=noise.sigma_px,
        radius_mm=float(np.sqrt((pairs.offsets**2).sum(axis=1).mean())),
        pivot_cam=transform_points(cam_from_model, pairs.pivot_model),
    )


def inverse_normal(jacobian: np.ndarray) -> np.ndarray:
    """``(M, 6)`` J -> (J^T J)^-1; singular values below 1e-10 of the largest are lifted to it, with columns scaled."""
    scale = np.maximum(np.linalg.norm(jacobian, axis=0), 1e-12)
    _, values, across = np.linalg.svd(jacobian / scale, full_matrices=False)
    values = np.maximum(values, 1e-10 * values[0])
    root = across.T / values / scale[:, None]
    return root @ root.T
