"""How 3D views show the alignment: through the frame's camera, ready to orbit about the surface, its shape in light."""

from collections.abc import Callable, Iterator

import bpy
import numpy as np
from mathutils import Matrix, Vector

from ..pipeline.blender.alignment import surface_object
from ..pipeline.errors import InputError
from . import from_scene
from .events import areas
from .pose import pivot_of

WORKSPACE = "oneframe_workspace"
"""Custom property of the add-on's workspace."""

VIEW_SENSOR_MM = 36.0
"""Blender's 3D views outside the camera have a lens for a sensor of this width."""

through_camera_handlers: list[Callable[[bpy.types.Area], None]] = []
"""Called with a 3D view that begins to look through the camera."""


def views(context: bpy.types.Context) -> list[bpy.types.Area]:
    """The 3D views that the add-on may change: of its own workspace, or of Blender without a window."""
    if context.screen is None or not (bpy.app.background or WORKSPACE in context.workspace):
        return []
    return [area for area in context.screen.areas if area.type == "VIEW_3D"]


def look_through_camera(context: bpy.types.Context) -> None:
    """Look through the camera in the context's 3D view, or else in the largest one; nothing if one already does.

    Without a camera, look at the surface.
    """
    scene, areas = context.scene, views(context)
    if scene.oneframe.camera_object is None:
        for area in areas:
            _look_at_surface(scene, area.spaces.active)
        return
    for area in areas:
        aim(scene, area.spaces.active)
    if not areas or any(area.spaces.active.region_3d.view_perspective == "CAMERA" for area in areas):
        return
    area = context.area if context.area in areas else max(areas, key=lambda area: area.width * area.height)
    through_camera(scene, area)


def follow_surface(context: bpy.types.Context, world_from_model: Matrix, moved_world_from_model: Matrix) -> None:
    """Move free views with the surface, which has moved, so that they show the same of it."""
    for area in views(context):
        region_3d = area.spaces.active.region_3d
        if region_3d.view_perspective != "CAMERA":
            region_3d.view_matrix = region_3d.view_matrix @ world_from_model @ moved_world_from_model.inverted()


def through_camera(scene: bpy.types.Scene, area: bpy.types.Area) -> None:
    """Look through the frame's camera in a 3D view."""
    space = area.spaces.active
    scene.camera = from_scene.camera_object_of(scene)
    space.use_local_camera = False
    # a lock would move the camera with the view
    space.lock_camera = False
    space.region_3d.view_perspective = "CAMERA"
    aim(scene, space)
    for handler in through_camera_handlers:
        handler(area)


def aim(scene: bpy.types.Scene, space: bpy.types.SpaceView3D) -> None:
    """Prepare a view for its first orbit: about the surface in view, seen as large as through the frame's camera.

    Blender leaves the camera for the point at the depth of the view's location; by default that is next to the lens,
    and the surface, hundreds of millimetres away, would be gone.
    """
    if from_scene.present_surface(scene) is None or space.region_3d.view_perspective != "CAMERA":
        return
    try:
        pivot, _ = pivot_of(scene)
        camera, pose = from_scene.camera(scene), from_scene.cam_from_model(scene)
    except InputError:
        # the panel reports it
        return
    surface, region_3d = from_scene.surface_of(scene), space.region_3d
    depth = max(float((pose[:3, :3] @ pivot + pose[:3, 3])[2]), 1.0)
    region_3d.view_location = surface.matrix_world @ Vector(pivot)
    region_3d.view_distance = depth
    space.lens = float(np.clip(VIEW_SENSOR_MM * camera.fx / max(camera.size_wh), 1, 250))
    space.clip_start, space.clip_end = 0.01 * depth, 10 * (depth + surface_object.radius_of(surface))


def _look_at_surface(scene: bpy.types.Scene, space: bpy.types.SpaceView3D) -> None:
    surface = from_scene.present_surface(scene)
    if surface is None:
        return
    radius = surface_object.radius_of(surface)
    space.region_3d.view_location = surface.matrix_world.translation
    space.region_3d.view_distance = 3 * radius
    space.clip_start, space.clip_end = 0.01 * radius, 100 * radius


def show_shape(context: bpy.types.Context) -> None:
    """Show the shape of a surface without colours, see :func:`light_shape`."""
    for area in views(context):
        area.spaces.active.shading.type = "SOLID"
        light_shape(area.spaces.active.shading)


def light_shape(shading: bpy.types.View3DShading) -> None:
    """Studio light, with ridges bright and valleys dark: what a person recognises on a surface without colours."""
    shading.light, shading.color_type = "STUDIO", "OBJECT"
    shading.show_cavity, shading.cavity_type = True, "SCREEN"


def spaces_of(surface: bpy.types.Object) -> Iterator[bpy.types.SpaceView3D]:
    """The 3D views of all windows whose scene aligns this surface."""
    for window, area in areas("VIEW_3D"):
        if window.scene.oneframe.surface == surface and (bpy.app.background or WORKSPACE in window.workspace):
            yield area.spaces.active
