"""Random drags of pins, which contradict each other: the surface stays in sight, and undo goes through all of them.

``ONEFRAME_DRAGS=1000`` drags as often as that; every few drags the landmarks are cleared, and the pose stays.
"""

import os

import bpy
import numpy as np

bpy.ops.preferences.addon_enable(module="bl_ext.user_default.oneframe")

import scenario_first_session as first_session
from bl_ext.user_default.oneframe.pipeline.transforms import transform_points
from bl_ext.user_default.oneframe.state import from_scene
from bl_ext.user_default.oneframe.ui.frame_view import surface_point_at

DRAGS, TOGETHER = int(os.environ.get("ONEFRAME_DRAGS", "8")), 8
TIMEOUT_S = 7200


def scenario(user):
    yield from user.open_case()
    yield from user.open_sidebar("OneFrame")
    scene = bpy.context.scene
    vertices = np.array([vertex.co for vertex in scene.oneframe.surface.data.vertices][::50])
    rng, poses, nearest_mm = np.random.default_rng(5), [], np.inf
    for drag in range(DRAGS):
        if drag and drag % TOGETHER == 0:
            with user.context():
                bpy.ops.oneframe.landmarks_clear()
            poses = []
        poses = poses or [from_scene.cam_from_model(scene)]
        start, end = random_drag(user, scene, rng)
        yield from user.drag(user.of_pixel(*start.tolist()), user.of_pixel(*end.tolist()))
        yield from user.redraw()
        pose = from_scene.cam_from_model(scene)
        poses.append(pose)
        points, camera = transform_points(pose, vertices), from_scene.camera(scene)
        nearest_mm = min(nearest_mm, float(points[:, 2].min()))
        assert nearest_mm > 0, drag
        pixels = camera.project(points)
        assert ((pixels > 0) & (pixels < camera.size_wh)).all(axis=1).sum() > 1, drag
    user.facts |= {"drags": DRAGS, "nearest mm": round(nearest_mm, 1)}
    yield from user.picture("1_dragged")
    for shift, wanted in ((False, poses[-2::-1]), (True, poses[1:])):
        for pose in wanted:
            yield from user.key("Z", user.middle(), ctrl=True, **({"shift": True} if shift else {}))
            yield from user.until(lambda pose=pose: np.allclose(pose_now(user), pose), "the pose")
    assert len(user.window.scene.oneframe.landmarks) == len(poses) - 1


def pose_now(user):
    """Undo makes the scene anew."""
    return from_scene.cam_from_model(user.window.scene)


def random_drag(user, scene, rng):
    """Pixels from and to which a pin goes, both in sight and apart from other pins."""
    size = from_scene.camera(scene).size_wh
    pins = [np.array(entry.pixel) for entry in scene.oneframe.landmarks]
    while True:
        start, end = rng.uniform((0, 0), size, (2, 2))
        if not (first_session.in_view(user, start) and first_session.in_view(user, end)):
            continue
        if any(np.linalg.norm(place - pin) < 40 for place in (start, end) for pin in pins):
            continue
        if surface_point_at(scene, start) is not None:
            return start, end
