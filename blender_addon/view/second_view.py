"""A second 3D view of the surface, free to orbit, for picking points that are hard to see in the camera view."""

import bpy
from mathutils import Vector

from ..registration import class_registration
from ..state import from_scene
from ..state.pivot import pivot_of
from ..ui.frame_view import window_region
from ..ui.operator import NeedsAlignment, Reporting

DISTANCE_FACTOR = 2.5
"""Distance of the orbit view from the pivot, relative to the radius of the visible surface."""


class _In3DView(NeedsAlignment):
    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        if context.space_data is None or context.space_data.type != "VIEW_3D":
            cls.poll_message_set("Needs a 3D view")
            return False
        return super().poll(context)


class ONEFRAME_OT_side_by_side(_In3DView, Reporting, bpy.types.Operator):
    """Show the camera view on the left, and the surface in a view that you can orbit freely on the right"""

    bl_idname = "oneframe.side_by_side"
    bl_label = "Side by Side"
    bl_options = {"REGISTER"}

    def run(self, context: bpy.types.Context) -> None:
        existing = set(context.screen.areas)
        views = [area for area in context.screen.areas if area.type == "VIEW_3D"]
        if len(views) == 1:
            with context.temp_override(area=context.area, region=window_region(context.area)):
                bpy.ops.screen.area_split(direction="VERTICAL", factor=0.5)
            views += [area for area in context.screen.areas if area not in existing]
        views.sort(key=lambda area: area.x)
        frame, orbit = views[0].spaces.active, views[-1].spaces.active
        frame.region_3d.view_perspective = "CAMERA"
        orbit.show_region_ui = views[-1] == context.area
        orbit.lock_camera = False
        orbit_surface(context.scene, orbit)


class ONEFRAME_OT_orbit_surface(_In3DView, Reporting, bpy.types.Operator):
    """Leave the camera view and look at the surface from nearby, free to orbit; the pose stays"""

    bl_idname = "oneframe.orbit_surface"
    bl_label = "Orbit Surface"
    bl_options = {"REGISTER"}

    def run(self, context: bpy.types.Context) -> None:
        context.space_data.lock_camera = False
        orbit_surface(context.scene, context.space_data)


def orbit_surface(scene: bpy.types.Scene, space: bpy.types.SpaceView3D) -> None:
    """Look at the surface in the camera's direction, but from nearby and free to orbit about the pivot."""
    pivot, radius = pivot_of(scene)
    surface, camera_object = from_scene.surface_of(scene), from_scene.camera_object_of(scene)
    view = space.region_3d
    view.view_perspective = "PERSP"
    view.view_location = surface.matrix_world @ Vector(pivot)
    view.view_rotation = camera_object.matrix_world.to_quaternion()
    view.view_distance = DISTANCE_FACTOR * radius
    space.clip_start, space.clip_end = 0.01 * radius, 1000 * radius


register, unregister = class_registration((ONEFRAME_OT_side_by_side, ONEFRAME_OT_orbit_surface))
