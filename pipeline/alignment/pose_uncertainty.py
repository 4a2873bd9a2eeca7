"""The uncertainty of a pose: covariance, 95 % confidence region and weakest direction."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ..camera.pinhole import PinholeCamera
from ..case.pose_record import PoseRecord
from ..files.numbers import format_two_digits
from ..transforms import cross_matrices, inverse_rigid, transform_points
from .confidence_region import f_quantile
from .reprojection import jacobian_at, twist_between

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

    @classmethod
    def about_points(
        cls, pivot_model: np.ndarray, covariance: np.ndarray, points_model: np.ndarray, cam_from_model: np.ndarray
    ) -> "PoseUncertainty":
        """That of a pose ``(4, 4)`` that does not come from clicks; ``(N, 3)`` points stand for the surface."""
        radius = float(np.sqrt(((points_model - pivot_model) ** 2).sum(axis=1).mean()))
        return cls(pivot_model, covariance, np.inf, np.nan, radius, transform_points(cam_from_model, pivot_model))

    @classmethod
    def stated(
        cls,
        record: PoseRecord,
        points_model: np.ndarray,
        cam_from_model: np.ndarray,
        mesh_from_model: np.ndarray,
    ) -> "PoseUncertainty | None":
        """That of the pose ``(4, 4)`` of a case, as its record states it; ``None`` if it states none.

        Without a covariance: by the standard deviations, about the mean of ``(N, 3)`` points of the surface.
        """
        if record.has_covariance:
            return cls.of_entry(record.table(), cam_from_model, mesh_from_model)
        if record.standard_deviation_mm is None or record.standard_deviation_deg is None:
            return None
        deviations = np.array([*record.standard_deviation_mm, *np.radians(record.standard_deviation_deg)])
        return cls.about_points(points_model.mean(axis=0), np.diag(deviations**2), points_model, cam_from_model)

    @classmethod
    def of_entry(
        cls, entry: Mapping[str, Any], cam_from_model: np.ndarray, mesh_from_model: np.ndarray
    ) -> "PoseUncertainty":
        """From :meth:`entry`, for the pose ``(4, 4)``."""
        pivot = transform_points(inverse_rigid(mesh_from_model), np.array(entry["pivot_mesh_mm"], float))
        covariance, radius = np.array(entry["covariance_mm_rad"], float), float(entry["radius_mm"])
        return cls(pivot, covariance, np.inf, np.nan, radius, transform_points(cam_from_model, pivot))

    def entry(self, mesh_from_model: np.ndarray) -> dict[str, Any]:
        """What lists of poses and :class:`.PoseRecord` keep, to be had back by :meth:`of_entry`."""
        pivot = transform_points(mesh_from_model, self.pivot_model)
        return {
            "covariance_mm_rad": tuple(map(tuple, self.covariance.tolist())),
            "pivot_mesh_mm": tuple(pivot.tolist()),
            "radius_mm": self.radius_mm,
        }

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
        along = self._view_axes() @ direction
        sign = np.sign(along[np.argmax(np.abs(along))])
        return sign * np.sqrt(values[-1]) * direction / scale

    @property
    def weakest(self) -> str:
        """The name of the largest component of :attr:`weakest_twist`, with that component's standard deviation."""
        scale = self._scale_to_mm()
        along = np.abs(self._view_axes() @ (self.weakest_twist * scale))
        number = int(np.argmax(along))
        axes = self._view_axes()
        covariance = axes @ self.covariance @ axes.T
        deviation = np.sqrt(covariance[number, number])
        return _DIRECTIONS[number].format(format_two_digits(deviation if number < 3 else np.degrees(deviation)))

    def deviations(self) -> dict[str, Any]:
        """The standard deviations that a :class:`.PoseRecord` keeps."""
        return {
            "standard_deviation_deg": tuple(self.rotation_deg.tolist()),
            "standard_deviation_mm": tuple(self.translation_mm.tolist()),
        }

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

    def widened(self, factor: float) -> "PoseUncertainty":
        """That of standard deviations ``factor`` times as large."""
        return replace(self, covariance=factor**2 * self.covariance)

    def plus(self, covariance: np.ndarray) -> "PoseUncertainty":
        """That with another ``(6, 6)`` covariance added, about the same pivot."""
        return replace(self, covariance=self.covariance + covariance)

    def about(self, pivot_model: np.ndarray, cam_from_model: np.ndarray) -> "PoseUncertainty":
        """The same uncertainty of the pose ``(4, 4)``, as that of a twist about another pivot ``(3,)``."""
        moved = np.eye(6)
        moved[:3, 3:] = -cross_matrices(cam_from_model[:3, :3] @ (pivot_model - self.pivot_model))
        return replace(
            self,
            pivot_model=pivot_model,
            covariance=moved @ self.covariance @ moved.T,
            pivot_cam=transform_points(cam_from_model, pivot_model),
        )

    def pixel_covariances(
        self, points_model: np.ndarray, camera: PinholeCamera, cam_from_model: np.ndarray
    ) -> np.ndarray:
        """``(N, 2, 2)`` covariances, px^2, of the projections of ``(N, 3)`` model points."""
        jacobians = jacobian_at(points_model, camera, cam_from_model, self.pivot_model)
        return jacobians @ self.covariance @ np.swapaxes(jacobians, -1, -2)

    def root_mean_square_px(self, points_model: np.ndarray, camera: PinholeCamera, cam_from_model: np.ndarray) -> float:
        """Root mean square displacement in the image of ``(N, 3)`` points, px."""
        covariances = self.pixel_covariances(points_model, camera, cam_from_model)
        return float(np.sqrt(np.trace(covariances, axis1=1, axis2=2).mean()))

    @property
    def points_around(self) -> np.ndarray:
        """``(6, 3)`` points all around the pivot, at the radius, that stand for the surface."""
        return self.pivot_model + self.radius_mm * np.concatenate([np.eye(3), -np.eye(3)])

    def spread_px(self, camera: PinholeCamera, cam_from_model: np.ndarray) -> float:
        """Root mean square displacement in the image of points all around the pivot, at the radius, px."""
        return self.root_mean_square_px(self.points_around, camera, cam_from_model)

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


@dataclass(frozen=True)
class PoseMode:
    """One of the poses that the evidence allows.

    Attributes
    ----------
    cam_from_model
        ``(4, 4)``, mm.
    uncertainty
        That of this pose, if it is the right one.
    probability
        That it is.
    inliers
        ``(N,)`` bool: the correspondences that it was fitted to.
    """

    cam_from_model: np.ndarray
    uncertainty: PoseUncertainty
    probability: float
    inliers: np.ndarray


def ellipse_outlines(covariances: np.ndarray, scale: float, corners: int = 48) -> np.ndarray:
    """``(N, 2, 2)`` covariances C -> ``(N, corners, 2)`` outlines of their ellipses about the origin.

    The points d with d^T C^-1 d = scale^2; the ellipse of a singular covariance degenerates to a line segment, and one
    without bounds, of too few pairs, has no finite points.
    """
    values, vectors = np.linalg.eigh(covariances)
    roots = vectors * np.sqrt(np.maximum(values, 0.0))[:, None, :]
    angle = np.linspace(0, 2 * np.pi, corners, endpoint=False)
    with np.errstate(invalid="ignore"):
        circle = scale * np.stack([np.cos(angle), np.sin(angle)])
        return np.swapaxes(roots @ circle, -1, -2)
