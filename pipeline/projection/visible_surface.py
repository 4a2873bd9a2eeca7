"""The part of a surface that a camera sees, sampled by a coarse grid of rays: its extent and its pivot."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from ..camera.pinhole import PinholeCamera
from ..transforms import camera_centre, inverse_rigid, transform_points

FirstHit = Callable[[Sequence[float], Sequence[float]], tuple[Iterable[float], Iterable[float]] | None]
"""Origin and direction of a ray (model frame) -> point and unit normal of the surface there; ``None`` if it misses."""


@dataclass(frozen=True)
class VisibleSurface:
    """Points of a surface that a camera sees.

    Attributes
    ----------
    points_model, normals_model
        ``(N, 3)`` points in mm and unit face normals, model frame; may be empty.
    pixels
        ``(N, 2)`` the points' pixels.
    rays
        Number of all rays cast.
    """

    points_model: np.ndarray
    normals_model: np.ndarray
    pixels: np.ndarray
    rays: int

    @property
    def image_fraction(self) -> float:
        """Fraction of the image that the surface covers, 0..1; accurate to about 1 / ``rays``."""
        return len(self.pixels) / self.rays

    @property
    def pivot_model(self) -> np.ndarray | None:
        """``(3,)`` mm, model frame: the visible point nearest to the mean of the pixels; ``None`` if there is none."""
        return None if len(self.pixels) == 0 else self.points_model[most_central(*self.pixels.T)]

    def radius_mm(self, pivot_model: np.ndarray) -> float:
        """Root mean square distance of the visible points from a pivot (3,), mm."""
        return float(np.sqrt(((self.points_model - pivot_model) ** 2).sum(axis=1).mean()))


def cast_grid(first_hit: FirstHit, camera: PinholeCamera, cam_from_model: np.ndarray, *, along: int) -> VisibleSurface:
    """Cast a grid of rays from a camera.

    Parameters
    ----------
    first_hit
        Casts one ray at the surface.
    camera, cam_from_model
        Intrinsics and pose (4x4, mm).
    along
        Number of rays along the longer side of the image.
    """
    pixels = camera.coarse_grid(along)
    directions = camera.rays_cam(pixels) @ inverse_rigid(cam_from_model)[:3, :3].T
    centre = camera_centre(cam_from_model).tolist()
    hits = [first_hit(centre, direction) for direction in directions.tolist()]
    found = [hit for hit in hits if hit is not None]
    points, normals = (np.array([hit[part] for hit in found], float).reshape(-1, 3) for part in (0, 1))
    return VisibleSurface(points, normals, pixels[[hit is not None for hit in hits]], len(pixels))


def pixel_points(
    depth_mm: np.ndarray, pixels: tuple[np.ndarray, ...], camera: PinholeCamera, cam_from_model: np.ndarray
) -> np.ndarray:
    """``(N, 3)`` float32 what a view of this depth ``(H, W)`` shows at rows and columns ``(N,)``, model frame, mm."""
    v, u = pixels
    points_cam = camera.rays_cam(np.stack([u, v], axis=1)) * depth_mm[v, u][:, None].astype(np.float64)
    return transform_points(inverse_rigid(cam_from_model), points_cam).astype(np.float32)


def central_point(depth_mm: np.ndarray, camera: PinholeCamera, cam_from_model: np.ndarray) -> np.ndarray:
    """``(3,)`` mm, model frame: the point at the middle of what ``(H, W)`` depths show; the origin if all are 0."""
    v, u = np.nonzero(depth_mm)
    if not len(v):
        return np.zeros(3)
    central = most_central(u, v)
    pixel = np.array([[u[central], v[central]]], float)
    point_cam = camera.rays_cam(pixel) * depth_mm[v[central], u[central]]
    point: np.ndarray = transform_points(inverse_rigid(cam_from_model), point_cam)[0]
    return point


def most_central(u: np.ndarray, v: np.ndarray) -> int:
    """Index of the pixel nearest to the mean of N pixels, of columns and rows ``(N,)``; N is at least 1."""
    return int(np.argmin((u - u.mean()) ** 2 + (v - v.mean()) ** 2))
