"""The first session: from an empty Blender to the sample aligned to less than a pixel, by pointer and keys, counted."""

from pathlib import Path

import bpy
import numpy as np
from bl_ext.user_default.oneframe.pipeline.blender.alignment import surface_object
from bl_ext.user_default.oneframe.pipeline.case.case_file import read_case
from bl_ext.user_default.oneframe.pipeline.transforms import transform_points
from bl_ext.user_default.oneframe.refine import operator
from bl_ext.user_default.oneframe.setup import open_case as sample_task
from bl_ext.user_default.oneframe.setup.alignment_record import pose_record
from bl_ext.user_default.oneframe.state import from_scene
from bl_ext.user_default.oneframe.ui.frame_view import surface_point_at

FEATURES = [(640, 330), (330, 190), (150, 600), (860, 560), (460, 540), (800, 190), (170, 250)]
"""Pixels of the frame at which the user recognises features; the first in the cavity, then far apart on the rim."""
CLICK_PX = np.array([[1.5, -1.0], [-1.0, -1.5], [1.0, 1.5]])
"""How far off the user lets the pins go."""
MOST_ACTIONS = 8


def scenario(user):
    yield from user.open_sidebar("OneFrame")
    yield from user.picture("1_empty")
    yield from user.press("open_sample")
    actions = 1
    yield from user.at_workbench()
    scene = bpy.context.scene
    yield from user.until(lambda: scene.oneframe.surface is not None, "the sample to be open")
    yield from user.redraw()
    assert len(sample_task.task_lines(scene)) == 4
    yield from user.picture("2_opened")

    true = read_case(Path(scene.oneframe.case_path).with_name(sample_task.TRUE)).cam_from_mesh
    pinned = yield from pin_features(user, points_of_features(scene, true), CLICK_PX)
    actions += pinned
    yield from refine(user)
    actions += 2
    user.facts |= {"px at the end": off_px(scene), "actions": actions}
    yield from user.picture("6_done")
    assert off_px(scene) < 1.0, user.facts
    assert actions <= MOST_ACTIONS


def pin_features(user, features, clicks_px):
    """Drag as many features as there are clicks, those in sight, to where they belong; returns how many."""
    scene, pinned = bpy.context.scene, 0
    for pixel, point in features:
        if pinned == len(clicks_px):
            break
        seen = from_scene.camera(scene).project(transform_points(from_scene.cam_from_model(scene), point[None]))[0]
        hit = surface_point_at(scene, seen)
        if hit is None or np.linalg.norm(hit - point) > 1.0 or not in_view(user, seen):
            continue
        yield from user.drag(user.of_pixel(*seen.tolist()), user.of_pixel(*(pixel + clicks_px[pinned]).tolist()))
        yield from user.redraw()
        pinned += 1
        assert len(scene.oneframe.landmarks) == pinned
        if pinned in (1, len(clicks_px)):
            yield from user.picture(f"{3 if pinned == 1 else 4}_{pinned}_pins")
    assert pinned == len(clicks_px), f"only {pinned} features were in sight"
    return pinned


def refine(user):
    """F, and Enter when the pose is there."""
    scene = bpy.context.scene
    before = from_scene.cam_from_model(scene)
    yield from user.key("F", user.middle())
    yield from user.until(lambda: operator.outcome(scene) is not None, "the refinement")
    yield from user.until(lambda: not np.array_equal(from_scene.cam_from_model(scene), before), "a refined pose")
    yield from user.picture("5_preview")
    yield from user.key("RET")
    yield from user.until(lambda: pose_record(scene).method == "refined", "the refined pose kept")
    yield from user.redraw()


def in_view(user, pixel):
    """Whether a pixel is free of the header, the toolbar and the sidebar."""
    region, sidebar = user.region(), user.region("UI")
    x, y = user.of_pixel(*pixel.tolist())
    return region.x + 70 < x < sidebar.x - 10 and region.y + 20 < y < region.y + region.height - 70


def points_of_features(scene, true):
    """Pixels of the features, and where on the surface they are: found at the true pose, unknown to the user."""
    surface, camera = from_scene.surface_of(scene), scene.oneframe.camera_object
    start = from_scene.cam_from_model(scene)
    surface_object.set_pose(camera, surface, true @ surface_object.mesh_from_model_of(surface))
    found = [(np.array(pixel, float), surface_point_at(scene, pixel)) for pixel in FEATURES]
    surface_object.set_pose(camera, surface, start)
    return [(pixel, point) for pixel, point in found if point is not None]


def off_px(scene):
    """As the task's last line says it."""
    return float(sample_task.task_lines(scene)[3].partition(": the bone is ")[2].split()[0])
