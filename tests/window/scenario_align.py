"""From a rough pose to an aligned one by a pin and landmarks, as an annotator does it; counts every click and key."""

import bpy
import numpy as np

bpy.ops.preferences.addon_enable(module="bl_ext.user_default.oneframe")

from bl_ext.user_default.oneframe.pipeline.blender.alignment import surface_object
from bl_ext.user_default.oneframe.pipeline.case.case_file import read_case
from bl_ext.user_default.oneframe.pipeline.transforms import rigid, rotation_from_vector, transform_points
from bl_ext.user_default.oneframe.state import from_scene
from bl_ext.user_default.oneframe.ui.frame_view import FrameView, surface_point_at

FEATURES = [(170, 250), (330, 190), (800, 190), (860, 560), (460, 540), (150, 600), (640, 330), (560, 120)]
"""Pixels of the frame at which the user recognises features."""
MOST_ACTIONS = 15


def scenario(user):
    true = read_case(user.case)
    rough = user.case.parent / "rough.toml"
    yield from user.open_case()
    scene = bpy.context.scene
    camera = from_scene.camera(scene)
    true_pose = from_scene.cam_from_model(scene)
    points = [surface_point_at(scene, pixel) for pixel in FEATURES]
    shown = visible_points(scene, camera)
    # 5 degrees and 12 mm off: about 200 px
    start = rigid(rotation_from_vector(np.radians([3.0, -2.5, 3.0])), [7.0, -6.0, 8.0]) @ true_pose
    surface_object.set_pose(scene.oneframe.camera_object, scene.oneframe.surface, start)
    with user.context():
        bpy.ops.oneframe.save_case(filepath=str(rough))
        bpy.ops.wm.read_homefile(use_factory_startup=False, app_template="")
    yield from user.redraw()

    counted = Counted(user)
    yield from user.open_sidebar("OneFrame")
    yield from user.picture("1_empty")
    yield from counted.press("oneframe.open_case")
    # a file is chosen by a double click
    counted.actions += 2
    yield from user.choose_file(rough)
    yield from user.at_workbench()
    scene = bpy.context.scene
    yield from user.until(lambda: scene.oneframe.case_path == str(rough), "the case to be open")
    user.facts["start_px"] = round(error_px(scene, camera, shown, true_pose), 1)
    yield from user.picture("2_opened")

    pairs = 0
    waiting = [(pixel, point) for pixel, point in zip(FEATURES, points, strict=True) if point is not None]
    for _ in range(2 * len(waiting)):
        if pairs == 6 or not waiting:
            break
        pixel, point = waiting.pop(0)
        pose = from_scene.cam_from_model(scene)
        seen = camera.project(transform_points(pose, point[None]))[0]
        hit = surface_point_at(scene, seen)
        # leave a feature that is hidden at the current pose for later
        if hit is None or np.linalg.norm(hit - point) > 1.0 or not in_view(user, scene, seen):
            waiting.append((pixel, point))
            continue
        if pairs == 0:
            # the tool that is active at first: a pin brings the surface near
            yield from counted.drag(place(user, scene, seen), place(user, scene, np.array(pixel, float)))
            with user.context():
                bpy.ops.wm.tool_set_by_id(name="oneframe.landmark_tool")
            counted.actions += 1
        else:
            yield from counted.click(place(user, scene, seen), shift=True)
            yield from counted.click(place(user, scene, np.array(pixel, float)))
        pairs += 1
        yield from user.redraw()
        user.facts[f"px after {pairs} pairs"] = round(error_px(scene, camera, shown, true_pose), 2)
    user.facts["actions"] = counted.actions
    yield from user.picture("3_landmarks")
    assert pairs == 6, f"only {pairs} pairs could be picked"
    assert error_px(scene, camera, shown, true_pose) < 2.0, user.facts
    assert counted.actions <= MOST_ACTIONS

    solved = from_scene.cam_from_model(scene)
    yield from user.key("Z", user.middle(), ctrl=True)
    yield from user.until(lambda: len(complete(bpy.context.scene)) == 5, "the last point undone")
    yield from user.key("Z", user.middle(), ctrl=True, shift=True)
    yield from user.until(lambda: len(complete(bpy.context.scene)) == 6, "the last point redone")

    yield from user.press("oneframe.save_case")
    yield from user.until(lambda: len(read_case(rough).landmarks) == 6, "the case to be saved")
    bpy.ops.wm.save_as_mainfile(filepath=str(user.folder / "work.blend"))
    bpy.ops.wm.open_mainfile(filepath=str(user.folder / "work.blend"))
    yield from user.redraw()
    scene = bpy.context.scene
    assert np.array_equal(from_scene.cam_from_model(scene), solved)
    assert len(complete(scene)) == 6
    saved = read_case(rough)
    assert saved.camera == true.camera
    given = from_scene.case(scene, rough)
    assert np.array_equal(saved.cam_from_mesh, given.cam_from_mesh)
    yield from user.picture("4_reopened")


class Counted:
    """Counts the user's actions."""

    def __init__(self, user):
        self.user, self.actions = user, 0

    def click(self, place, **modifiers):
        self.actions += 1
        yield from self.user.click(place, **modifiers)

    def drag(self, start, end):
        self.actions += 1
        yield from self.user.drag(start, end)

    def press(self, name):
        self.actions += 1
        yield from self.user.press(name)


def complete(scene):
    return [entry for entry in scene.oneframe.landmarks if entry.has_point and entry.has_pixel]


def place(user, scene, pixel):
    """The position of a frame pixel in the window."""
    region = user.region()
    x, y = FrameView.of(scene, region, user.view).region_from_px(pixel)
    return region.x + x, region.y + y


def in_view(user, scene, pixel):
    x, y = place(user, scene, pixel)
    region, sidebar = user.region(), user.region("UI")
    return region.x + 70 < x < sidebar.x - 10 and region.y + 20 < y < region.y + region.height - 70


def visible_points(scene, camera):
    """Visible points of the surface."""
    u, v = np.meshgrid(np.linspace(20, camera.width - 20, 12), np.linspace(20, camera.height - 20, 9))
    found = [surface_point_at(scene, pixel) for pixel in np.stack([u.ravel(), v.ravel()], axis=1)]
    return np.array([point for point in found if point is not None])


def error_px(scene, camera, points, true_pose):
    """Mean distance in the frame between the projections of surface points at the current and at the true pose."""
    here, there = (
        camera.project(transform_points(pose, points)) for pose in (from_scene.cam_from_model(scene), true_pose)
    )
    return float(np.linalg.norm(here - there, axis=1).mean())
