"""What of a surface a camera sees, by a coarse grid of rays: how much of it, and the point to turn about."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from ..camera.pinhole import PinholeCamera
from ..transforms import camera_centre, inverse_rigid

FirstHit = Callable[[Sequence[float], Sequence[float]], tuple[Iterable[float], Iterable[float]] | None]
"""Origin and direction of a ray (model frame) -> point and unit normal of the surface there; ``None`` if it misses."""


@dataclass(frozen=True)
class VisibleSurface:
    """Points of a surface that a camera sees.

    Attributes
    ----------
    points_model, normals_model
        ``(N, 3)`` mm and unit face normals, model frame; may be empty.
    pixels
        ``(N, 2)`` where they are seen.
    rays
        Number of rays cast, whether they hit or not.
    """

    points_model: np.ndarray
    normals_model: np.ndarray
    pixels: np.ndarray
    rays: int

    @property
    def image_fraction(self) -> float:
        """Share of the image that the surface covers, 0..1; known to about 1 / ``rays``."""
        return len(self.pixels) / self.rays

    @property
    def pivot_model(self) -> np.ndarray | None:
        """``(3,)`` the seen point nearest to the middle of what is seen; ``None`` if nothing is."""
        return None if len(self.pixels) == 0 else self.points_model[most_central(self.pixels)]

    def radius_mm(self, pivot_model: np.ndarray) -> float:
        """Root mean square distance of the seen points from a pivot."""
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
        Rays along the longer side of the image.
    """
    pixels = camera.coarse_grid(along)
    directions = camera.rays_cam(pixels) @ inverse_rigid(cam_from_model)[:3, :3].T
    centre = camera_centre(cam_from_model).tolist()
    hits = [first_hit(centre, direction) for direction in directions.tolist()]
    found = [hit for hit in hits if hit is not None]
    points, normals = (np.array([hit[part] for hit in found], float).reshape(-1, 3) for part in (0, 1))
    return VisibleSurface(points, normals, pixels[[hit is not None for hit in hits]], len(pixels))


def most_central(pixels: np.ndarray) -> int:
    """Index of the one of ``(N, 2)`` pixels that lies nearest to their mean; N is at least 1."""
    return int(np.argmin(((pixels - pixels.mean(axis=0)) ** 2).sum(axis=1)))
