"""The part of the surface object that the camera sees, for the pivot and the step sizes of edits."""

from collections.abc import Sequence

import bpy
import numpy as np
from mathutils import Vector

from ...camera.pinhole import PinholeCamera
from ...errors import InputError
from ...projection.visible_surface import VisibleSurface, cast_grid

GRID = 12
"""Number of rays along the longer side of the frame."""


def first_hit(
    surface: bpy.types.Object, origin: Sequence[float] | Vector, direction: Sequence[float] | Vector
) -> tuple[Vector, Vector] | None:
    """Point and normal where a ray (model frame) first meets the surface object, ``None`` if it misses.

    Raises
    ------
    InputError
        The object is not in the view layer, so Blender has no evaluated mesh.
    """
    try:
        hit, point, normal, _ = surface.ray_cast(origin, direction)
    except RuntimeError:  # Blender raises nothing more specific
        raise InputError(
            f"{surface.name}: expected a surface in the view layer, its collection is excluded or disabled; "
            "enable the collection in the Outliner"
        ) from None
    return (point, normal) if hit else None


def visible_surface(surface: bpy.types.Object, camera: PinholeCamera, cam_from_model: np.ndarray) -> VisibleSurface:
    """Cast a grid of rays from the camera at the surface object (evaluated, in Object mode); see :func:`first_hit`."""
    return cast_grid(
        lambda origin, direction: first_hit(surface, origin, direction), camera, cam_from_model, along=GRID
    )
