"""Distributions of novel camera poses around the reference pose of the aligned frame.

Every distribution is a frozen dataclass of options, whose numbers have been checked as :class:`.DatasetOptions`. View
``i`` of a dataset is drawn with ``np.random.default_rng([seed, i])`` alone, so views can be rendered in any order, by
any number of processes. A draw takes its random numbers in a fixed order, whatever the parameters: another
``shift_mm`` does not change the tilts of a dataset.

Cone, shell and trajectory move the camera on an orbit around the pivot p, a point on the surface. With the reference
R0 (rotation of ``cam_from_model``) and the unit vector u from the camera to the pivot in the reference camera's axes,

    cam_from_model = T(distance * u) Roll(u, rho) Tilt R0 T(-p),    Tilt = exp([w]x) with w perpendicular to u.

T(a) is the translation by a. Tilt rotates by |w| about an axis perpendicular to the pivot's ray, hence without twist
about that ray, and Roll rotates by rho about the ray. So the pivot stays on its ray, and on its pixel.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Self

import numpy as np

from ..errors import InputError
from ..transforms import inverse_rigid, rigid, rotation_between, rotation_from_vector, se3_exp, transform_points


@dataclass(frozen=True)
class ReferencePose:
    """The pose of the aligned frame and the point that the camera moves around.

    Attributes
    ----------
    cam_from_model
        ``(4, 4)`` rigid, mm.
    pivot_model
        ``(3,)`` mm: the surface point at the centre of the observed region; in front of the camera.
    """

    cam_from_model: np.ndarray
    pivot_model: np.ndarray

    def __post_init__(self) -> None:
        if not self.pivot_cam[2] > 0:
            raise InputError(
                f"reference pose: expected the pivot in front of the camera, found z = {self.pivot_cam[2]:g} mm; "
                "check the alignment of the frame"
            )

    @cached_property
    def pivot_cam(self) -> np.ndarray:
        """``(3,)`` the pivot in the reference camera, mm."""
        return transform_points(self.cam_from_model, np.asarray(self.pivot_model, float)[None])[0]

    @cached_property
    def distance_mm(self) -> float:
        """Distance from the centre of projection to the pivot."""
        return float(np.linalg.norm(self.pivot_cam))

    @cached_property
    def cam_from_ray(self) -> np.ndarray:
        """``(3, 3)`` rotation whose third column is the pivot's ray and whose first two span the plane of tilt axes."""
        return rotation_between(np.array([0.0, 0.0, 1.0]), self.pivot_cam)

    def orbit(
        self, tilt: tuple[float, float], roll: float, distance_mm: float, look: np.ndarray | None = None
    ) -> np.ndarray:
        """``(4, 4)`` ``cam_from_model`` on the orbit that the module's docstring defines.

        Parameters
        ----------
        tilt
            Components of w in the plane perpendicular to the pivot's ray, radians.
        roll
            Angle about the pivot's ray, radians.
        distance_mm
            Distance from the centre of projection to the pivot.
        look
            ``(3,)`` direction of the pivot in the camera's axes; as in the reference if left out.
        """
        ray = self.cam_from_ray[:, 2]
        rotation = rotation_from_vector(self.cam_from_ray @ [*tilt, 0.0]) @ self.cam_from_model[:3, :3]
        if look is not None:
            rotation = rotation_between(ray, look) @ rotation
            ray = look / np.linalg.norm(look)
        rotation = rotation_from_vector(roll * ray) @ rotation
        return rigid(rotation, distance_mm * ray - rotation @ self.pivot_model)


@dataclass(frozen=True, kw_only=True)
class PoseDistribution:
    """A distribution of camera poses around a reference."""

    reference: ReferencePose

    @classmethod
    def of(cls, reference: ReferencePose, middle_ray_cam: np.ndarray, options: Mapping[str, float]) -> Self:
        """The distribution with the values of its options; ``(3,)`` is the ray of the image's middle."""
        return cls(reference=reference, **options)

    def draw(self, rng: np.random.Generator) -> np.ndarray:
        """Draw one ``(4, 4)`` rigid ``cam_from_model``, mm."""
        raise NotImplementedError

    def fixed_pose(self, index: int, count: int) -> np.ndarray | None:
        """The pose of view ``index`` of ``count``, if it is not drawn."""
        return None

    @property
    def distances(self) -> tuple[float, float]:
        """Least and greatest distance from the pivot, relative to the reference's, of most poses."""
        return 1.0, 1.0

    def farthest_mm(self, radius_mm: float) -> float:
        """A depth that a surface of this radius hardly ever exceeds."""
        pivot_mm = float(np.linalg.norm(self.reference.pivot_model))
        return self.reference.distance_mm * max(self.distances[1], 1.0) + (radius_mm + pivot_mm)


@dataclass(frozen=True, kw_only=True)
class Orbit(PoseDistribution):
    """Distances between two multiples of the reference's."""

    distance_min: float = 1.0
    distance_max: float = 1.0

    @property
    def distances(self) -> tuple[float, float]:
        """As the options say."""
        return self.distance_min, self.distance_max


@dataclass(frozen=True, kw_only=True)
class Cone(Orbit):
    """Views from a spherical cap around the reference view; the camera keeps the pivot on the reference's pixel.

    Attributes
    ----------
    cone_deg
        Half-angle of the cap, 0..180; directions from the pivot to the camera are uniform by solid angle.
    roll_deg
        In-plane roll about the ray through the pivot, uniform in -roll_deg..roll_deg, 0..180.
    distance_min, distance_max
        The distance from the camera to the pivot is uniform between these multiples of the reference's distance.
    shift_mm
        Afterwards the camera moves along its own x and y by a vector that is uniform in a disc of this radius.
    """

    cone_deg: float
    roll_deg: float = 0.0
    shift_mm: float = 0.0

    def draw(self, rng: np.random.Generator) -> np.ndarray:
        """Draw one ``(4, 4)`` ``cam_from_model``."""
        polar, azimuth, roll, distance, shift_radius, shift_angle = rng.random(6)
        factor = self.distance_min + distance * (self.distance_max - self.distance_min)
        cam_from_model = self.reference.orbit(
            _tilt_in_cap(self.cone_deg, polar, azimuth), _roll(self.roll_deg, roll), factor * self.reference.distance_mm
        )
        radius, angle = self.shift_mm * np.sqrt(shift_radius), 2 * np.pi * shift_angle
        cam_from_model[:2, 3] -= radius * np.cos(angle), radius * np.sin(angle)
        return cam_from_model


@dataclass(frozen=True, kw_only=True)
class Gaussian(PoseDistribution):
    """A Gaussian on se(3) around the reference, with its tangent space at the pivot.

    ``cam_from_model = reference @ T(pivot) @ Exp(xi) @ T(-pivot)`` with xi = (upsilon, omega),
    upsilon ~ N(0, sigma_mm^2 1) and omega ~ N(0, sigma_deg^2 1), a rotation vector, both in the axes of the model, and
    Exp as in :func:`oneframe.transforms.se3_exp`. As both are isotropic, the camera's axes would give the same
    distribution. Rotations are about the pivot: with ``sigma_mm = 0`` it does not move.

    Attributes
    ----------
    sigma_deg, sigma_mm
        Standard deviations per axis. Rotations wrap around at 180 degrees, so ``sigma_deg`` up to about 50 makes sense.
    """

    sigma_deg: float
    sigma_mm: float

    def farthest_mm(self, radius_mm: float) -> float:
        """At four standard deviations."""
        return super().farthest_mm(radius_mm) + 4 * self.sigma_mm

    def draw(self, rng: np.random.Generator) -> np.ndarray:
        """Draw one ``(4, 4)`` ``cam_from_model``."""
        twist = rng.standard_normal(6) * np.repeat([self.sigma_mm, np.radians(self.sigma_deg)], 3)
        model_from_pivot = rigid(translation=self.reference.pivot_model)
        return self.reference.cam_from_model @ model_from_pivot @ se3_exp(twist) @ inverse_rigid(model_from_pivot)


@dataclass(frozen=True, kw_only=True)
class Shell(Orbit):
    """Cameras that look at the pivot, their centres uniform *in volume* in a spherical shell or its part in a cone.

    The radius has p(r) ~ r^2, drawn by inverting its distribution function: r^3 is uniform. With
    ``polar_deg = roll_deg = 180`` the rotation is uniform on SO(3).

    Attributes
    ----------
    distance_min, distance_max
        Radii of the shell as multiples of the reference's distance.
    polar_deg
        Half-angle of the cone around the direction from the pivot to the reference camera; 180: the whole sphere.
    roll_deg
        In-plane roll, uniform in -roll_deg..roll_deg.
    look_ray_cam
        Direction of the pivot in the camera's axes. The default is the optical axis; a camera whose principal point is
        far from the middle of the image (a cropped frame) needs the ray of the middle pixel.
    """

    polar_deg: float = 180.0
    roll_deg: float = 180.0
    look_ray_cam: tuple[float, float, float] = (0.0, 0.0, 1.0)

    @classmethod
    def of(cls, reference: ReferencePose, middle_ray_cam: np.ndarray, options: Mapping[str, float]) -> Self:
        """The shell whose cameras have the pivot in the middle of the image."""
        return cls(reference=reference, look_ray_cam=tuple(middle_ray_cam), **options)

    def draw(self, rng: np.random.Generator) -> np.ndarray:
        """Draw one ``(4, 4)`` ``cam_from_model``."""
        polar, azimuth, roll, volume = rng.random(4)
        inner, outer = self.distance_min**3, self.distance_max**3
        factor = np.cbrt(inner + volume * (outer - inner))
        return self.reference.orbit(
            _tilt_in_cap(self.polar_deg, polar, azimuth),
            _roll(self.roll_deg, roll),
            factor * self.reference.distance_mm,
            look=np.array(self.look_ray_cam),
        )


@dataclass(frozen=True, kw_only=True)
class Trajectory(Orbit):
    """A smooth closed path that starts at the reference and stays within the limits of a :class:`Cone`.

    The tilt runs through a rose curve, w(t) = cone sin(6 pi t) (cos 4 pi t, sin 4 pi t): six petals that reach the rim
    of the cap, at a speed that varies by a factor of only 1.5. Distance and roll are sinusoidal. All terms are
    analytic and have period 1 in t, so the path has no kink, not even where it closes.

    Attributes
    ----------
    cone_deg, roll_deg, distance_min, distance_max
        Limits as for :class:`Cone`; the path reaches all of them. The interval of distances must contain 1.
    """

    cone_deg: float
    roll_deg: float = 0.0

    @classmethod
    def of(cls, reference: ReferencePose, middle_ray_cam: np.ndarray, options: Mapping[str, float]) -> Self:
        """The path whose distances include 1, where it starts."""
        nearest, farthest = min(options["distance_min"], 1.0), max(options["distance_max"], 1.0)
        return cls(reference=reference, **{**options, "distance_min": nearest, "distance_max": farthest})

    def fixed_pose(self, index: int, count: int) -> np.ndarray:
        """The pose at this part of the path."""
        return self.pose_at(index / count)

    def pose_at(self, phase: float) -> np.ndarray:
        """``(4, 4)`` ``cam_from_model`` at a phase; the path has period 1."""
        angle = 2 * np.pi * (phase % 1.0)
        tilt = np.radians(self.cone_deg) * np.sin(3 * angle)
        roll = np.radians(self.roll_deg) * np.sin(2 * angle)
        middle, half = (self.distance_max + self.distance_min) / 2, (self.distance_max - self.distance_min) / 2
        # start where the sine between the limits passes 1: a piecewise scaling would have a kink there
        start = np.arcsin(np.clip((1 - middle) / half, -1, 1)) if half > 0 else 0.0
        factor = middle + half * np.sin(angle + start)
        return self.reference.orbit(
            (tilt * np.cos(2 * angle), tilt * np.sin(2 * angle)), roll, factor * self.reference.distance_mm
        )

    def poses(self, count: int) -> np.ndarray:
        """``(count, 4, 4)`` poses at equal steps of the phase: one loop of a video."""
        return np.stack([self.fixed_pose(index, count) for index in range(count)])

    def draw(self, rng: np.random.Generator) -> np.ndarray:
        """Draw the pose at a uniformly random phase: a still from the path."""
        return self.pose_at(rng.random())


@dataclass(frozen=True, kw_only=True)
class Listed(PoseDistribution):
    """The user's own poses.

    ``(N, 4, 4)`` ``cam_from_model``, mm.
    """

    poses: np.ndarray

    def fixed_pose(self, index: int, count: int) -> np.ndarray:
        """As listed."""
        pose: np.ndarray = self.poses[index]
        return pose

    def farthest_mm(self, radius_mm: float) -> float:
        """As of :func:`farthest_listed_mm`."""
        return farthest_listed_mm(self.poses, radius_mm)


def farthest_listed_mm(poses: np.ndarray, radius_mm: float) -> float:
    """A depth that a surface of this radius does not exceed at listed poses, ``(N, 4, 4)`` cam_from_model, mm."""
    return float(poses[:, 2, 3].max()) + radius_mm


def _tilt_in_cap(half_angle_deg: float, polar: float, azimuth: float) -> tuple[float, float]:
    """Two numbers uniform in [0, 1) -> tilt vector whose direction is uniform by solid angle in the cap, radians.

    The area of a cap grows with 1 - cos(angle) = 2 sin^2(angle / 2) (Archimedes); the form with the half angle is
    accurate for caps of any size.
    """
    angle = 2 * np.arcsin(np.sqrt(polar) * np.sin(np.radians(half_angle_deg) / 2))
    return angle * np.cos(2 * np.pi * azimuth), angle * np.sin(2 * np.pi * azimuth)


def _roll(roll_deg: float, uniform: float) -> float:
    return np.radians(roll_deg) * (2 * uniform - 1)
