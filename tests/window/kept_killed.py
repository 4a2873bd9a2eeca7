"""The first frame of a queue is pulled and checked, the second one only pulled, a second before the kill."""

import json
import os
import signal

import bpy
import numpy as np
from bl_ext.user_default.oneframe.case_queue import queued
from bl_ext.user_default.oneframe.state import from_scene
from bl_ext.user_default.oneframe.ui.keymap import PIN_TOOL, active_tool

SHIFT_PX, SETTLED_S = 14, 1.0


def scenario(user):
    for number in (1, 2):
        (user.case.parent / f"later_{number}.png").write_bytes((user.case.parent / "frame.png").read_bytes())
    yield from user.open_case()
    user.plain_view()
    scene, files = bpy.context.scene, [{"name": f"later_{number}.png"} for number in (1, 2)]
    user.call("queue_frames", "EXEC_DEFAULT", True, directory=str(user.case.parent), files=files)
    assert len(queued.queue_of(scene)) == 3
    zoom = user.view.view_camera_zoom
    yield from pull(user)
    pulled = from_scene.cam_from_model(scene)
    # a drag and a key for each frame: the next one starts at this pose, and view and tool stay
    yield from user.key("PAGE_DOWN", user.middle(), alt=True)
    yield from user.until(lambda: queued.position(scene) == 1, "the next frame")
    yield from user.redraw()
    assert np.array_equal(from_scene.cam_from_model(scene), pulled)
    assert (len(scene.oneframe.landmarks), user.view.view_camera_zoom) == (0, zoom)
    with user.context():
        assert active_tool(bpy.context) == PIN_TOOL
    yield from pull(user)
    poses = {"1": from_scene.cam_from_mesh(scene).tolist()}
    (user.case.parent / "poses.json").write_text(json.dumps(poses))
    yield SETTLED_S
    os.kill(os.getpid(), signal.SIGKILL)


def pull(user):
    x, y = user.middle()
    yield from user.drag((x, y), (x + SHIFT_PX, y))
