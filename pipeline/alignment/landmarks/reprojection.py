"""Where the points of the pairs fall in the frame, and how that moves with the pose; for many poses at once."""

from dataclasses import dataclass

import numpy as np

from ...camera.pinhole import PinholeCamera
from ...transforms import cross_matrices, rigid, rotation_from_vector, rotation_vector, transform_points


@dataclass(frozen=True)
class Correspondences:
    """Points of the model and the pixels where they were clicked.

    The points are kept relative to a pivot, which keeps the numbers small and the two halves of a twist apart, however
    far from its origin the model lies and however long the lens is.

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
        """Pairs about a pivot; without one, about the mean of the points."""
        pivot = points_model.mean(axis=0) if pivot_model is None else np.asarray(pivot_model, float)
        return cls(points_model - pivot, pixels, camera, pivot)

    def __len__(self) -> int:
        return len(self.offsets)

    def __getitem__(self, chosen: np.ndarray | list[int]) -> "Correspondences":
        """Some of the pairs, about the same pivot."""
        return Correspondences(self.offsets[chosen], self.pixels[chosen], self.camera, self.pivot_model)


@dataclass(frozen=True)
class Poses:
    """K poses about the pivot of some pairs: cam = rotation @ offset + position.

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
        """From ``(K, 4, 4)`` matrices."""
        rotations = cam_from_model[:, :3, :3]
        return cls(rotations, cam_from_model[:, :3, 3] + rotations @ pivot_model)

    def __len__(self) -> int:
        return len(self.rotations)

    def __getitem__(self, chosen: np.ndarray | list[int]) -> "Poses":
        """Some of the poses."""
        return Poses(self.rotations[chosen], self.positions[chosen])

    def matrix(self, number: int, pivot_model: np.ndarray) -> np.ndarray:
        """``(4, 4)`` cam_from_model of one of them."""
        rotation = self.rotations[number]
        return rigid(rotation, self.positions[number] - rotation @ pivot_model)


def residuals(pairs: Correspondences, poses: Poses) -> tuple[np.ndarray, np.ndarray]:
    """Clicked minus predicted pixels ``(K, N, 2)``, NaN behind the camera, and the turned offsets ``(K, N, 3)``."""
    turned = pairs.offsets @ np.swapaxes(poses.rotations, -1, -2)
    predicted = pairs.camera.project(turned + poses.positions[:, None])
    return pairs.pixels - predicted, turned


def twist_jacobians(camera: PinholeCamera, turned: np.ndarray, positions: np.ndarray) -> np.ndarray:
    """Change of the predicted pixels with a twist about the pivot.

    Parameters
    ----------
    turned
        ``(K, N, 3)`` points minus the pivot in camera axes, mm.
    positions
        ``(K, 3)`` the pivot in the camera frame, mm.

    Returns
    -------
    ``(K, N, 2, 6)`` px per mm, px per radian.
    """
    x, y, z = np.moveaxis(turned + positions[:, None], -1, 0)
    with np.errstate(divide="ignore", invalid="ignore"):
        inverse = 1 / z
    jacobians = np.zeros((*turned.shape[:-1], 2, 6))
    jacobians[..., 0, 0] = camera.fx * inverse
    jacobians[..., 0, 2] = -camera.fx * x * inverse**2
    jacobians[..., 1, 1] = camera.fy * inverse
    jacobians[..., 1, 2] = -camera.fy * y * inverse**2
    # a rotation w moves the point by w x turned = -[turned]x w
    jacobians[..., 3:] = -jacobians[..., :3] @ cross_matrices(turned)
    return jacobians


def jacobian_at(
    points_model: np.ndarray, camera: PinholeCamera, cam_from_model: np.ndarray, pivot_model: np.ndarray
) -> np.ndarray:
    """``(N, 2, 6)``: :func:`twist_jacobians` at one pose, for points ``(N, 3)`` of the model."""
    turned = (points_model - pivot_model) @ cam_from_model[:3, :3].T
    return twist_jacobians(camera, turned[None], transform_points(cam_from_model, pivot_model)[None])[0]


def moved_by(twist: np.ndarray, cam_from_model: np.ndarray, pivot_model: np.ndarray) -> np.ndarray:
    """The pose ``(4, 4)`` after a twist ``(6,)`` in camera axes about a pivot ``(3,)`` of the model, mm."""
    rotation = rotation_from_vector(np.asarray(twist[3:], float)) @ cam_from_model[:3, :3]
    pivot_cam = transform_points(cam_from_model, pivot_model) + twist[:3]
    return rigid(rotation, pivot_cam - rotation @ pivot_model)


def twist_between(cam_from_model: np.ndarray, other: np.ndarray, pivot_model: np.ndarray) -> np.ndarray:
    """The twist ``(6,)`` about a pivot of the model that moves one pose to another: the inverse of :func:`moved_by`."""
    translation = transform_points(other, pivot_model) - transform_points(cam_from_model, pivot_model)
    return np.concatenate([translation, rotation_vector(other[:3, :3] @ cam_from_model[:3, :3].T)])
