"""A second 3D view of the surface, free to orbit, for picking points that are hard to see in the camera view."""

import bpy

from ..state import camera_view, from_scene
from ..state.pose import pivot_of
from ..ui.frame_view import window_region
from ..ui.operator import NeedsAlignment, Reporting
from .workspace import show_tab


class _In3DView(NeedsAlignment):
    needs = (lambda context: getattr(context.space_data, "type", "") == "VIEW_3D", "Needs a 3D view")


def second_view(screen: bpy.types.Screen) -> bpy.types.Area | None:
    """The right one of two 3D views of a screen; ``None`` if it has one."""
    views = sorted((area for area in screen.areas if area.type == "VIEW_3D"), key=lambda area: area.x)
    return views[-1] if len(views) > 1 else None


class ONEFRAME_OT_side_by_side(_In3DView, Reporting):
    """Show the frame on the left, and the surface in a view that you can orbit freely on the right; again: one view"""

    bl_label = "Side by Side"
    bl_options = {"REGISTER"}

    def run(self, context: bpy.types.Context) -> None:
        window, screen, scene = context.window, context.screen, context.scene
        extra = second_view(screen)
        if extra is not None:
            with context.temp_override(area=extra, region=window_region(extra)):
                bpy.ops.screen.area_close()
            # found again: closing frees one of the two areas, and may keep the right one
            (left,) = (area for area in screen.areas if area.type == "VIEW_3D")
            # the context was that of the closed area; Blender crashes where it shows a region without a window
            with context.temp_override(window=window, area=left, region=window_region(left)):
                space = left.spaces.active
                space.show_region_ui = space.show_region_toolbar = space.show_region_tool_header = True
                space.overlay.show_extras = True
                camera_view.through_camera(scene, left)
            show_tab(left)
            return
        area = context.area
        before, sidebar_px = set(context.screen.areas), covered_px(area)
        # the sidebar covers the view: both pictures get the same width beside it
        share = 0.5 + 0.5 * sidebar_px / max(area.width, 1)
        with context.temp_override(area=area, region=window_region(area)):
            bpy.ops.screen.area_split(direction="VERTICAL", factor=min(share, 0.75))
        (new,) = set(context.screen.areas) - before
        left, right = sorted((area, new), key=lambda each: each.x)
        for each in (left, right):
            space = each.spaces.active
            space.show_region_ui = each == left
            space.show_region_toolbar = space.show_region_tool_header = each == left
            space.lock_camera = False
        # the frame's camera would stand before the surface
        right.spaces.active.overlay.show_extras = False
        camera_view.through_camera(context.scene, left)
        orbit_surface(context.scene, right.spaces.active)


def covered_px(area: bpy.types.Area) -> int:
    """Width of the sidebar that lies over a 3D view."""
    sidebar = next(region for region in area.regions if region.type == "UI")
    return sidebar.width if area.spaces.active.show_region_ui and sidebar.width > 1 else 0


class ONEFRAME_OT_orbit_surface(_In3DView, Reporting):
    """Leave the camera view and orbit about the surface; the pose stays"""

    bl_label = "Orbit Surface"
    bl_options = {"REGISTER"}

    def run(self, context: bpy.types.Context) -> None:
        context.space_data.lock_camera = False
        orbit_surface(context.scene, context.space_data)


def orbit_surface(scene: bpy.types.Scene, space: bpy.types.SpaceView3D) -> None:
    """Look at the surface from where the camera is, but free to orbit about the pivot.

    Raises
    ------
    InputError
        There is no camera or surface, or the surface is in Edit mode.
    """
    pivot_of(scene)  # raises what the user can fix
    camera_object, view = from_scene.camera_object_of(scene), space.region_3d
    view.view_perspective = "CAMERA"
    camera_view.aim(scene, space)
    view.view_perspective = "PERSP"
    view.view_rotation = camera_object.matrix_world.to_quaternion()
