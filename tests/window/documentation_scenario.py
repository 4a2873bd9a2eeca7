"""The user's actions for the pictures of the documentation; ``test_documentation_pictures.py`` plays them.

Runs inside Blender's window: see ``user.py``. Each picture shows the whole window; ``facts["crops"]``
holds the part that the documentation shows: left, top, width, height in px.
"""

from typing import Any

import bpy
import numpy as np
from bl_ext.user_default.oneframe.state import from_scene
from bl_ext.user_default.oneframe.ui.frame_view import surface_point_at
from bl_ext.user_default.oneframe.view.zoom import STATUS_PX
from mathutils import Quaternion
from user import Action, User

operators: Any = bpy.ops
"""With the add-on's own, which Blender's type stubs do not know."""

TIMEOUT_S = 600
FEATURES = [(170, 250), (330, 190), (150, 600), (460, 540), (860, 560), (640, 330), (800, 190), (560, 120)]
"""Pixels of the frame where the user clicks, at recognisable features."""
CLICK_SIGMA_PX = 2.0
WRONG = 6, (20.0, -14.0)
"""Index of the wrong click, and its error in px."""


def scenario(user: User) -> Action:
    user.facts["crops"] = {}
    yield from user.open_case()
    yield from user.open_sidebar("OneFrame")
    # the navigation gizmo would cover labels
    user.area.spaces.active.show_gizmo_navigate = False
    with user.context():
        operators.oneframe.fit_frame()
    yield from user.redraw()
    yield from landmarks(user)
    yield from colour(user)


def landmarks(user: User) -> Action:
    """Eight correspondences with 2 px of click noise, one of them wrong."""
    scene = bpy.context.scene
    rng = np.random.default_rng(4)
    with user.context():
        bpy.ops.wm.tool_set_by_id(name="oneframe.landmark_tool")
        for number, pixel in enumerate(FEATURES):
            point = surface_point_at(scene, pixel)
            off = WRONG[1] if number == WRONG[0] else rng.normal(0, CLICK_SIGMA_PX, 2)
            operators.oneframe.landmark_set(point=point, pixel=np.add(pixel, off))
    yield from user.redraw()
    yield from window_picture(user, "landmarks")
    with user.context():
        operators.oneframe.landmarks_clear()
        bpy.ops.wm.tool_set_by_id(name="oneframe.pin_tool")


def colour(user: User) -> Action:
    """The frame's colours seen from the side, blue where the frame saw nothing."""
    scene, view = bpy.context.scene, user.view
    camera, space = from_scene.camera_object_of(scene), user.area.spaces.active
    for structure in from_scene.surface_of(scene).children:
        structure.hide_viewport = True
    space.show_region_ui = space.show_region_toolbar = space.show_region_tool_header = False
    space.overlay.show_text = space.overlay.show_axis_x = space.overlay.show_axis_y = False
    yield 0.5
    with user.context():
        assert operators.oneframe.project_colour(mode="texture") == {"FINISHED"}
        bpy.ops.view3d.view_camera()
    tilted(view, camera, 35)
    view.view_distance *= 1.15
    yield from view_picture(user, "colour", width=1100)


def tilted(view: bpy.types.RegionView3D, camera: bpy.types.Object, angle_deg: float) -> None:
    """Look as the frame's camera does, rotated about its x axis; at 90 degrees from the side, the camera on top."""
    view.view_rotation = camera.matrix_world.to_quaternion() @ Quaternion((1, 0, 0), np.radians(angle_deg))


def window_picture(user: User, name: str) -> Action:
    """Keep the 3D view with its header, toolbar and sidebar."""
    area = user.area
    # off the sidebar, so that nothing is highlighted there
    yield from user.move((area.x + 0.3 * area.width, area.y + 4))
    yield from picture(user, name, area.x, area.y, area.width, area.height)


def view_picture(user: User, name: str, width: int) -> Action:
    """Keep the middle of the view without its header and the status line."""
    region, header = user.region(), user.region("HEADER").height + round(STATUS_PX)
    left = region.x + (region.width - width) // 2
    yield from picture(user, name, left, region.y, width, region.height - header)


def picture(user: User, name: str, left: int, below: int, width: int, height: int) -> Action:
    yield from user.picture(name)
    user.facts["crops"][name] = [left, user.window.height - below - height, width, height]
