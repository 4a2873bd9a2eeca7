"""Reprojection of 2D-3D correspondences: residuals and their derivatives by a twist, for many poses at once.

A twist ``(6,)`` is a motion of a pose about a pivot: a translation in mm, then a rotation vector in radians, both along
the axes of ``cam``. Applied to a pose (R, t) about a pivot P of the model, seen at p = R P + t, it moves a point y of
the camera frame to exp(rotation) (y - p) + p + translation. So P moves by the translation alone, whatever the rotation,
and both have a meaning in the image: the pivot shifts, the model rotates about it. (The two are coupled in
:func:`oneframe.transforms.se3_exp`.)
"""

from dataclasses import dataclass

import numpy as np

from ..camera.pinhole import PinholeCamera
from ..transforms import rigid, rotation_from_vector, rotation_vector, transform_points


@dataclass(frozen=True)
class Correspondences:
    """Points of the model and the pixels where they were clicked.

    The points are stored relative to a pivot, the one of all twists: this keeps the normal equations well conditioned
    for a model far from its origin and for long lenses.

    Attributes
    ----------
    offsets
        ``(N, 3)`` points minus the pivot, model axes, mm.
    pixels
        ``(N, 2)`` clicked pixels of the undistorted frame.
    camera
        Intrinsics.
    pivot_model
        ``(3,)`` mm.
    """

    offsets: np.ndarray
    pixels: np.ndarray
    camera: PinholeCamera
    pivot_model: np.ndarray

    @classmethod
    def about(
        cls, points_model: np.ndarray, pixels: np.ndarray, camera: PinholeCamera, pivot_model: np.ndarray | None = None
    ) -> "Correspondences":
        """From ``(N, 3)`` points, mm, and ``(N, 2)`` pixels; the pivot is the mean of the points if left out."""
        pivot = points_model.mean(axis=0) if pivot_model is None else np.asarray(pivot_model, float)
        return cls(points_model - pivot, pixels, camera, pivot)

    def __len__(self) -> int:
        return len(self.offsets)

    def __getitem__(self, chosen: np.ndarray | list[int]) -> "Correspondences":
        """A selection, about the same pivot."""
        return Correspondences(self.offsets[chosen], self.pixels[chosen], self.camera, self.pivot_model)


@dataclass(frozen=True)
class Poses:
    """K poses about the pivot of some correspondences: point_cam = rotation @ offset + position.

    Attributes
    ----------
    rotations
        ``(K, 3, 3)``.
    positions
        ``(K, 3)`` the pivot in the camera frame, mm.
    """

    rotations: np.ndarray
    positions: np.ndarray

    @classmethod
    def of(cls, cam_from_model: np.ndarray, pivot_model: np.ndarray) -> "Poses":
        """From ``(K, 4, 4)`` matrices and the ``(3,)`` pivot."""
        rotations = cam_from_model[:, :3, :3]
        return cls(rotations, cam_from_model[:, :3, 3] + rotations @ pivot_model)

    def __len__(self) -> int:
        return len(self.rotations)

    def __getitem__(self, chosen: np.ndarray | list[int]) -> "Poses":
        """A selection."""
        return Poses(self.rotations[chosen], self.positions[chosen])

    def matrix(self, number: int, pivot_model: np.ndarray) -> np.ndarray:
        """``(4, 4)`` cam_from_model of one of them, given the ``(3,)`` pivot."""
        rotation = self.rotations[number]
        return rigid(rotation, self.positions[number] - rotation @ pivot_model)


def residuals(correspondences: Correspondences, poses: Poses) -> tuple[np.ndarray, np.ndarray]:
    """Clicked minus predicted pixels ``(K, N, 2)``, and the offsets in camera axes ``(K, N, 3)``, mm.

    Residuals of points behind the camera are NaN.
    """
    offsets_cam = correspondences.offsets @ np.swapaxes(poses.rotations, -1, -2)
    predicted = correspondences.camera.project(offsets_cam + poses.positions[:, None])
    return correspondences.pixels - predicted, offsets_cam


def twist_jacobians(camera: PinholeCamera, offsets_cam: np.ndarray, positions: np.ndarray) -> np.ndarray:
    """Derivatives of the predicted pixels by a twist about the pivot: ``(K, N, 2, 6)`` px per mm, px per radian.

    Parameters
    ----------
    camera
        Intrinsics.
    offsets_cam
        ``(K, N, 3)`` points minus the pivot, camera axes, mm.
    positions
        ``(K, 3)`` the pivot in the camera frame, mm.
    """
    x, y, z = np.moveaxis(offsets_cam + positions[:, None], -1, 0)
    with np.errstate(divide="ignore", invalid="ignore"):
        inverse = 1 / z
    jacobians = np.zeros((*offsets_cam.shape[:-1], 2, 6))
    jacobians[..., 0, 0] = camera.fx * inverse
    jacobians[..., 0, 2] = -camera.fx * x * inverse**2
    jacobians[..., 1, 1] = camera.fy * inverse
    jacobians[..., 1, 2] = -camera.fy * y * inverse**2
    # a rotation w moves the point by w x offset
    jacobians[..., 3:] = np.cross(offsets_cam[..., None, :], jacobians[..., :3])
    return jacobians


def jacobian_at(
    points_model: np.ndarray, camera: PinholeCamera, cam_from_model: np.ndarray, pivot_model: np.ndarray
) -> np.ndarray:
    """``(N, 2, 6)``: :func:`twist_jacobians` of ``(N, 3)`` model points at one pose."""
    offsets_cam = (points_model - pivot_model) @ cam_from_model[:3, :3].T
    return twist_jacobians(camera, offsets_cam[None], transform_points(cam_from_model, pivot_model)[None])[0]


def zoom_jacobian_at(
    points_model: np.ndarray, camera: PinholeCamera, cam_from_model: np.ndarray, pivot_model: np.ndarray
) -> np.ndarray:
    """``(N, 2, 7)``: :func:`jacobian_at`, then the derivatives by the logarithm of the focal length."""
    from_centre = camera.project(transform_points(cam_from_model, points_model)) - [camera.cx, camera.cy]
    by_twist = jacobian_at(points_model, camera, cam_from_model, pivot_model)
    return np.concatenate([by_twist, from_centre[:, :, None]], axis=2)


def apply_twist(twist: np.ndarray, cam_from_model: np.ndarray, pivot_model: np.ndarray) -> np.ndarray:
    """The pose ``(4, 4)`` after a twist ``(6,)`` about a pivot ``(3,)`` of the model."""
    rotation = rotation_from_vector(np.asarray(twist[3:], float)) @ cam_from_model[:3, :3]
    pivot_cam = transform_points(cam_from_model, pivot_model) + twist[:3]
    return rigid(rotation, pivot_cam - rotation @ pivot_model)


def twist_between(cam_from_model: np.ndarray, other: np.ndarray, pivot_model: np.ndarray) -> np.ndarray:
    """The twist ``(6,)`` about a pivot ``(3,)`` of the model that moves one pose to another.

    The inverse of :func:`apply_twist`.
    """
    translation = transform_points(other, pivot_model) - transform_points(cam_from_model, pivot_model)
    return np.concatenate([translation, rotation_vector(other[:3, :3] @ cam_from_model[:3, :3].T)])
