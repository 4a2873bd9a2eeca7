"""The user's actions for the pictures of the documentation; ``test_documentation_pictures.py`` plays them.

Runs inside Blender's window: see ``user.py``. Each picture shows the whole window; ``facts["crops"]``
holds the part that the documentation shows: left, top, width, height in px.
"""

from importlib import import_module
from typing import Any

import bpy
import numpy as np
from bl_ext.user_default.oneframe.pipeline.blender.alignment import surface_object
from bl_ext.user_default.oneframe.pipeline.transforms import rigid, rotation_from_vector
from bl_ext.user_default.oneframe.state import from_scene
from bl_ext.user_default.oneframe.ui.frame_view import surface_point_at
from bl_ext.user_default.oneframe.video import session
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
DISTURBED = rigid(rotation_from_vector(np.radians([0.3, 0.2, 3.0])), [-0.5, -0.6, 6.0])
"""Error of the rough pose that the contour shows."""
FILM = ("clear", "tool", "clear", "hand", "blur", "clear", "glare", "clear", "blood", "clear")


def scenario(user: User) -> Action:
    user.facts["crops"] = {}
    yield from user.open_case()
    yield from user.open_sidebar("OneFrame")
    # the navigation gizmo would cover labels
    user.area.spaces.active.show_gizmo_navigate = False
    yield from whole_frame(user)
    yield from window_picture(user, "sidebar")
    yield from landmarks(user)
    yield from contour(user)
    yield from colour(user)
    yield from video(user)


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


def contour(user: User) -> Action:
    """A rough pose by contour, without the sidebar."""
    scene, space = bpy.context.scene, user.area.spaces.active
    true = from_scene.cam_from_model(scene)
    surface_object.set_pose(scene.oneframe.camera_object, scene.oneframe.surface, DISTURBED @ true)
    for structure in from_scene.surface_of(scene).children:
        structure.hide_viewport = True
    space.show_region_ui = space.show_region_toolbar = space.show_region_tool_header = False
    space.overlay.show_text = space.overlay.show_axis_x = space.overlay.show_axis_y = False
    yield 0.5
    yield from whole_frame(user)
    yield from frame_picture(user, "contour")
    surface_object.set_pose(scene.oneframe.camera_object, scene.oneframe.surface, true)


def colour(user: User) -> Action:
    """The frame's colours seen from the side, blue where the frame saw nothing."""
    scene, view = bpy.context.scene, user.view
    camera = from_scene.camera_object_of(scene)
    with user.context():
        assert operators.oneframe.project_colour(mode="texture") == {"FINISHED"}
        bpy.ops.view3d.view_camera()
    tilted(view, camera, 35)
    view.view_distance *= 1.15
    yield from view_picture(user, "colour", width=1100)


def tilted(view: bpy.types.RegionView3D, camera: bpy.types.Object, angle_deg: float) -> None:
    """Look as the frame's camera does, rotated about its x axis; at 90 degrees from the side, the camera on top."""
    view.view_rotation = camera.matrix_world.to_quaternion() @ Quaternion((1, 0, 0), np.radians(angle_deg))


def video(user: User) -> Action:
    """A film of the sample's own frame, with faults put in, and its Timeline."""
    cv2, films = import_module("cv2"), import_module("video.surgical_film")
    frame = np.ascontiguousarray(cv2.imread(str(user.case.parent / "frame.png"))[..., ::-1])
    events = [films.Event(kind, 12 * number, 12 * (number + 1)) for number, kind in enumerate(FILM)]
    film = films.surgical_film([frame], events, np.random.default_rng(1))
    path = films.write_film(user.folder / "surgery.avi", film, "MJPG")
    scene, space = bpy.context.scene, user.area.spaces.active
    space.show_region_ui = space.show_region_toolbar = space.show_region_tool_header = True
    scene.oneframe_view.contour = False
    with user.context():
        operators.oneframe.show_frame()
    yield from user.open_sidebar("OneFrame")
    yield from whole_frame(user)
    with user.context():
        operators.oneframe.open_video(filepath=str(path))
        scene.frame_set(18)
    yield from user.until(lambda: session.scored(scene).is_full, "the full frame")
    timeline = next(each for each in user.window.screen.areas if each.type == "DOPESHEET_EDITOR")
    yield from user.until(lambda: scene.timeline_markers, "the best frames", timeout_s=120)
    yield 0.5
    yield from window_picture(user, "video", timeline)


def whole_frame(user: User) -> Action:
    """Show the whole frame beside toolbar and sidebar."""
    with user.context():
        operators.oneframe.fit_frame()
    yield from user.redraw()


def window_picture(user: User, name: str, below: bpy.types.Area | None = None) -> Action:
    """Keep the 3D view with its header, toolbar and sidebar, and an area below it."""
    area = user.area
    # off the sidebar, so that nothing is highlighted there
    yield from user.move((area.x + 0.3 * area.width, area.y + 4))
    bottom = area.y if below is None else below.y
    yield from picture(user, name, area.x, bottom, area.width, area.y + area.height - bottom)


def view_picture(user: User, name: str, width: int) -> Action:
    """Keep the middle of the view without its header and the status line."""
    region, header = user.region(), user.region("HEADER").height + round(STATUS_PX)
    left = region.x + (region.width - width) // 2
    yield from picture(user, name, left, region.y, width, region.height - header)


def frame_picture(user: User, name: str) -> Action:
    """Keep the part of the view in which the frame is, without the status line."""
    seen, region = user.frame_view, user.region()
    width, height = seen.camera.size_wh
    (left, low), (right, high) = seen.region_from_px([[0, height - 1], [width - 1, 0]]).round().astype(int).tolist()
    below = user.region("HEADER").height + round(STATUS_PX)
    low, high = max(low, 0), min(high, region.height - below)
    left, right = max(left, 0), min(right, region.width)
    yield from picture(user, name, region.x + left, region.y + low, right - left, high - low)


def picture(user: User, name: str, left: int, below: int, width: int, height: int) -> Action:
    yield from user.picture(name)
    user.facts["crops"][name] = [left, user.window.height - below - height, width, height]
