"""The current pose: the pivot of its moves, and its text in the convention of the case file."""

import bpy
import numpy as np

from ..pipeline.blender.alignment import surface_object
from ..pipeline.blender.alignment.surface_object import visible_surface
from ..pipeline.blender.bridge.data_blocks import exact, set_exact
from ..pipeline.case.case_file import MM_PER_UNIT
from ..pipeline.errors import InputError
from ..pipeline.transforms import transform_points
from . import from_scene

previewed = ""
"""Label of the operator whose pose is previewed now: it is not the case's until the user takes it."""

PIVOT = "oneframe_pivot"
"""Custom property of the surface: the pivot and its radius, in the frame and units of the mesh file."""
PIVOT_DRIFT = 0.1
"""The stored pivot is kept while it projects near the centre of the visible surface: within this fraction of the
frame's size. With a new pivot at each step, steps back and forth would not cancel."""


def pivot_of(scene: bpy.types.Scene) -> tuple[np.ndarray, float]:
    """``(3,)`` pivot (model frame, mm), and the radius of the visible surface about it, mm."""
    surface, camera, pose = from_scene.surface_of(scene), from_scene.camera(scene), from_scene.cam_from_model(scene)
    if surface.mode == "EDIT":
        raise InputError("expected Object mode; press Tab to leave Edit mode, then move the surface")
    visible = visible_surface(surface, camera, pose)
    centre = visible.pivot_model
    if centre is None:
        # out of view: move about the origin, so that the user can bring the surface back
        return np.zeros(3), surface_object.radius_of(surface) / 2
    stored = exact(surface, PIVOT)
    if stored is not None and stored.shape == (4,):
        kept_mm = MM_PER_UNIT[scene.oneframe.units] * stored
        pivot = kept_mm[:3] - surface_object.mesh_from_model_of(surface)[:3, 3]
        drift = np.diff(camera.project(transform_points(pose, np.stack([pivot, centre]))), axis=0)[0]
        if np.abs(drift).max() < PIVOT_DRIFT * max(camera.size_wh):
            return pivot, float(kept_mm[3])
    return centre, visible.radius_mm(centre)


def keep_pivot(scene: bpy.types.Scene, pivot_model: np.ndarray, radius_mm: float) -> None:
    """Store the pivot of a move, so that the move back rotates about the same point."""
    surface = from_scene.surface_of(scene)
    pivot_mesh = pivot_model + surface_object.mesh_from_model_of(surface)[:3, 3]
    set_exact(surface, PIVOT, np.array([*pivot_mesh, radius_mm]) / MM_PER_UNIT[scene.oneframe.units])


def set_cam_from_model(scene: bpy.types.Scene, cam_from_model: np.ndarray) -> None:
    """Move the surface to a pose ``(4, 4)``, mm."""
    surface_object.set_pose(from_scene.camera_object_of(scene), from_scene.surface_of(scene), cam_from_model)


def set_cam_from_mesh(scene: bpy.types.Scene, cam_from_mesh: np.ndarray) -> None:
    """Move the surface to a pose ``(4, 4)`` in the frame and units of the mesh file."""
    cam_from_mesh = cam_from_mesh.copy()
    cam_from_mesh[:3, 3] *= MM_PER_UNIT[scene.oneframe.units]
    set_cam_from_model(scene, cam_from_mesh @ surface_object.mesh_from_model_of(from_scene.surface_of(scene)))
