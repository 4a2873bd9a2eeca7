"""The initial pose of a surface, which lasts until somebody moves it, and what it looks at."""

import bpy
import numpy as np

from ..pipeline.blender.alignment import alignment_scene, surface_object
from ..pipeline.blender.bridge.data_blocks import exact, set_exact
from ..pipeline.camera.pinhole import PinholeCamera
from ..pipeline.case.case_file import MM_PER_UNIT
from ..pipeline.case.pose_record import INITIAL_GUESS, UNKNOWN, PoseRecord
from ..pipeline.errors import InputError
from ..pipeline.projection.initial_pose import initial_pose
from ..pipeline.surface.mesh import Ball, TriangleMesh
from . import from_scene, pose_evidence
from .camera_view import follow_surface

FOCUS = "oneframe_focus"
"""Custom property of the surface: the ball that its initial pose looks at, its centre and radius, in the frame and
units of the mesh file."""


def is_sought(scene: bpy.types.Scene) -> bool:
    """Whether the surface began at an initial pose, and neither four landmarks nor a refinement have found one yet."""
    if from_scene.present_surface(scene) is None or not scene.oneframe.began_at_guess:
        return False
    try:
        is_refined = pose_evidence.is_refined(scene)
    except InputError:
        return False
    return not is_refined and sum(entry.has_point and entry.has_pixel for entry in scene.oneframe.landmarks) < 4


def is_initial(scene: bpy.types.Scene, pose: np.ndarray) -> bool:
    """Whether a pose ``(4, 4)``, mm, is the surface's initial one."""
    return (pose_evidence.record_of(scene, pose) or UNKNOWN).method == INITIAL_GUESS


def set_focus(scene: bpy.types.Scene, focus: Ball | None) -> None:
    """Remember what an initial pose looks at: a ball in the frame of the mesh file, mm, or nothing."""
    surface = from_scene.surface_of(scene)
    if focus is not None:
        ball = focus.rounded()
        set_exact(surface, FOCUS, np.array([*ball.centre, ball.radius_mm]) / MM_PER_UNIT[scene.oneframe.units])
    elif FOCUS in surface:
        del surface[FOCUS]


def set_initial_pose(scene: bpy.types.Scene) -> None:
    """Give the surface its initial pose, for the present K."""
    camera_object, surface = from_scene.present_camera(scene), from_scene.surface_of(scene)
    # without K any camera will do: the initial pose is found again when K is set
    camera = PinholeCamera(1920, 1080, 12800, 12800, 959.5, 539.5)
    if camera_object is not None:
        camera = from_scene.camera(scene)
    stored, focus = exact(surface, FOCUS), None
    if stored is not None and stored.shape == (4,):
        ball = MM_PER_UNIT[scene.oneframe.units] * stored
        focus = Ball(ball[:3] - surface_object.mesh_from_model_of(surface)[:3, 3], float(ball[3]))
    mesh = _mesh_as_read(scene, surface)
    pose = initial_pose(mesh, camera, focus)
    surface_object.set_pose(camera_object, surface, pose)
    pose_evidence.remember(scene, PoseRecord(INITIAL_GUESS), pose)
    scene.oneframe.began_at_guess = True
    if camera_object is not None:
        alignment_scene.fit_clip(camera_object, mesh.radius, pose)


def renew_initial_pose(context: bpy.types.Context, focus: Ball | None) -> None:
    """Remember another focus (frame of the mesh file, mm); a pose that nobody has changed looks at it from now on.

    Free views keep what they show: they move with the surface.
    """
    scene = context.scene
    camera_object, surface = from_scene.present_camera(scene), from_scene.surface_of(scene)
    set_focus(scene, focus)
    pose = surface_object.pose_of(camera_object, surface)
    # without K nothing looks through the camera; with it, the initial pose is found again
    if camera_object is None or not is_initial(scene, pose) or scene.oneframe.landmarks:
        return
    before = surface.matrix_world.copy()
    set_initial_pose(scene)
    follow_surface(context, before, surface.matrix_world)


def _mesh_as_read(scene: bpy.types.Scene, surface: bpy.types.Object) -> TriangleMesh:
    """The surface (model frame) in the digits of its file, as scripts read it; that of Blender if it was edited."""
    try:
        mesh = from_scene.surface_in_file(scene)
        from_scene.check_mesh_unedited(scene)
    except InputError:
        return surface_object.edited_mesh(surface)
    return mesh
