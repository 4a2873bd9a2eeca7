"""The pivot of every move: the surface point in the middle of what the frame shows, kept while that stays near it."""

import bpy
import numpy as np

from ..pipeline.blender.alignment import surface_object
from ..pipeline.blender.alignment.visible_surface import visible_surface
from ..pipeline.blender.bridge.exact_values import exact, set_exact
from ..pipeline.errors import InputError
from ..pipeline.transforms import transform_points
from . import from_scene

PIVOT = "oneframe_pivot_model"
PIVOT_DRIFT = 0.1
"""The pivot is kept while the middle of what is seen stays this near to it, in parts of the frame's size: otherwise
steps there and back would not cancel."""


def pivot_of(scene: bpy.types.Scene) -> tuple[np.ndarray, float]:
    """``(3,)`` pivot (model frame, mm) and the radius in mm that the surface in view has about it.

    Raises
    ------
    InputError
        Nothing is set up, or the surface is in Edit mode.
    """
    surface, camera, pose = from_scene.surface_of(scene), from_scene.camera(scene), from_scene.cam_from_model(scene)
    if surface.mode == "EDIT":
        raise InputError("expected Object mode; press Tab to leave Edit mode, then move the surface")
    seen = visible_surface(surface, camera, pose)
    fresh = seen.pivot_model
    if fresh is None:
        # out of sight: about its origin, so that it can be brought back
        return np.zeros(3), surface_object.radius_of(surface) / 2
    kept = exact(surface, PIVOT)
    if kept is not None and kept.shape == (4,):
        points_cam = transform_points(pose, np.stack([kept[:3], fresh]))
        drift = np.diff(camera.project(points_cam), axis=0)[0] / max(camera.size_wh)
        if np.abs(drift).max() < PIVOT_DRIFT:
            return kept[:3], float(kept[3])
    return fresh, seen.radius_mm(fresh)


def keep_pivot(scene: bpy.types.Scene, pivot_model: np.ndarray, radius_mm: float) -> None:
    """Keep the pivot of a move, so that the move back turns about the same point."""
    set_exact(from_scene.surface_of(scene), PIVOT, np.array([*pivot_model, radius_mm]))
