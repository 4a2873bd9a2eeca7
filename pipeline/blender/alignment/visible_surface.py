"""What of the surface the camera sees, by a coarse grid of rays: the pivot of edits, and how far they reach."""

from dataclasses import dataclass

import bpy
import numpy as np
from mathutils import Vector

from ...camera.pinhole import PinholeCamera
from ...errors import InputError
from ...transforms import camera_centre, inverse_rigid

GRID = 12
"""Rays along the longer side of the frame."""


@dataclass(frozen=True)
class VisibleSurface:
    """Points of the surface that the frame shows.

    Attributes
    ----------
    points_model
        ``(N, 3)`` mm, model frame; may be empty.
    pixels
        ``(N, 2)`` where they are seen.
    """

    points_model: np.ndarray
    pixels: np.ndarray

    @property
    def pivot_model(self) -> np.ndarray | None:
        """``(3,)`` the seen point nearest to the middle of what is seen; ``None`` if nothing is."""
        if len(self.pixels) == 0:
            return None
        offset = self.pixels - self.pixels.mean(axis=0)
        return self.points_model[np.argmin((offset**2).sum(axis=1))]

    def radius_mm(self, pivot_model: np.ndarray) -> float:
        """Root mean square distance of the seen points from a pivot."""
        return float(np.sqrt(((self.points_model - pivot_model) ** 2).sum(axis=1).mean()))


def first_hit(surface: bpy.types.Object, origin: Vector, direction: Vector) -> Vector | None:
    """Where a ray (model frame) first meets the surface object, ``None`` if it misses.

    Raises
    ------
    InputError
        Blender does not keep the mesh ready, because the object is not in the view layer.
    """
    try:
        hit, point, _, _ = surface.ray_cast(origin, direction)
    except RuntimeError:  # Blender's only way to say so
        raise InputError(
            f"{surface.name}: expected a surface that is in the view layer, its collection is excluded or disabled; "
            "enable the collection in the Outliner"
        ) from None
    return point if hit else None


def visible_surface(surface: bpy.types.Object, camera: PinholeCamera, cam_from_model: np.ndarray) -> VisibleSurface:
    """Cast a grid of rays from the camera at the surface object (evaluated, in Object mode); see :func:`first_hit`."""
    pixels = camera.coarse_grid(GRID)
    model_from_cam = inverse_rigid(cam_from_model)
    centre = Vector(camera_centre(cam_from_model))
    points, seen = [], []
    for pixel, direction in zip(pixels, camera.rays_cam(pixels) @ model_from_cam[:3, :3].T, strict=True):
        point = first_hit(surface, centre, Vector(direction))
        if point is not None:
            points.append(point[:])
            seen.append(pixel)
    return VisibleSurface(np.array(points, float).reshape(-1, 3), np.array(seen, float).reshape(-1, 2))
