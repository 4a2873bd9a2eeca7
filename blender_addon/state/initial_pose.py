"""The initial pose of a surface, which lasts until somebody moves it, and what it looks at."""

import bpy
import numpy as np

from ..pipeline.blender.alignment import alignment_scene, surface_object
from ..pipeline.blender.bridge.data_blocks import exact, set_exact
from ..pipeline.camera.pinhole import PinholeCamera
from ..pipeline.errors import InputError
from ..pipeline.projection.initial_pose import initial_pose
from ..pipeline.surface.mesh import Ball, TriangleMesh
from . import from_scene, pose_evidence
from .camera_view import follow_surface

INITIAL_POSE, FOCUS = "oneframe_first_pose", "oneframe_focus"
"""Custom properties of the surface: its automatic initial pose, found again when K is set while it is still in use; and
the ball that this pose looks at, its centre and radius in mm, in the frame of the mesh file."""


def has_initial_pose(scene: bpy.types.Scene) -> bool:
    """Whether the surface still has the pose that was computed when it was loaded.

    Raises
    ------
    InputError
        There is no camera or surface, or the surface is scaled, sheared or mirrored.
    """
    return is_initial(from_scene.surface_of(scene), from_scene.cam_from_model(scene))


def is_sought(scene: bpy.types.Scene) -> bool:
    """Whether the surface began at an initial pose, and neither four landmarks nor a refinement have found one yet."""
    surface = from_scene.present_surface(scene)
    if surface is None or INITIAL_POSE not in surface:
        return False
    try:
        is_refined = pose_evidence.is_refined(scene)
    except InputError:
        return False
    return not is_refined and sum(entry.has_point and entry.has_pixel for entry in scene.oneframe.landmarks) < 4


def is_initial(surface: bpy.types.Object, pose: np.ndarray) -> bool:
    """Whether a pose ``(4, 4)``, mm, is the surface's initial one."""
    initial = exact(surface, INITIAL_POSE)
    return initial is not None and np.array_equal(initial, pose)


def set_focus(surface: bpy.types.Object, focus: Ball | None) -> None:
    """Remember what an initial pose looks at: a ball in the frame of the mesh file, mm, or nothing."""
    if focus is not None:
        ball = focus.rounded()
        set_exact(surface, FOCUS, [*ball.centre, ball.radius_mm])
    elif FOCUS in surface:
        del surface[FOCUS]


def set_initial_pose(scene: bpy.types.Scene, surface: bpy.types.Object) -> None:
    """Give the surface its initial pose, for the present K."""
    camera_object = from_scene.present_camera(scene)
    # without K any camera will do: the initial pose is found again when K is set
    camera = PinholeCamera(1920, 1080, 12800, 12800, 959.5, 539.5)
    if camera_object is not None:
        camera = from_scene.camera(scene)
    stored, focus = exact(surface, FOCUS), None
    if stored is not None and stored.shape == (4,):
        focus = Ball(stored[:3] - surface_object.mesh_from_model_of(surface)[:3, 3], float(stored[3]))
    mesh = _mesh_as_read(scene, surface)
    pose = initial_pose(mesh, camera, focus)
    surface_object.set_pose(camera_object, surface, pose)
    set_exact(surface, INITIAL_POSE, pose)
    if camera_object is not None:
        alignment_scene.fit_clip(camera_object, mesh.radius, pose)


def renew_initial_pose(context: bpy.types.Context, focus: Ball | None) -> None:
    """Remember another focus (frame of the mesh file, mm); a pose that nobody has changed looks at it from now on.

    Free views keep what they show: they move with the surface.
    """
    scene = context.scene
    camera_object, surface = from_scene.present_camera(scene), from_scene.surface_of(scene)
    set_focus(surface, focus)
    pose = surface_object.pose_of(camera_object, surface)
    # without K nothing looks through the camera; with it, the initial pose is found again
    if camera_object is None or not is_initial(surface, pose) or scene.oneframe.landmarks:
        return
    before = surface.matrix_world.copy()
    set_initial_pose(scene, surface)
    follow_surface(context, before, surface.matrix_world)


def _mesh_as_read(scene: bpy.types.Scene, surface: bpy.types.Object) -> TriangleMesh:
    """The surface (model frame) in the digits of its file, as scripts read it; that of Blender if it was edited."""
    try:
        mesh = from_scene.surface_in_file(scene)
        from_scene.check_mesh_unedited(scene)
    except InputError:
        return surface_object.edited_mesh(surface)
    return mesh
