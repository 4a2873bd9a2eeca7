"""The first frame of a queue is pulled and checked, the second one only pulled, a second before the kill."""

import json
import os
import signal

import bpy
from bl_ext.user_default.oneframe.case_queue import queued
from bl_ext.user_default.oneframe.state import from_scene

SHIFT_PX, SETTLED_S = 14, 1.0


def scenario(user):
    for number in (1, 2):
        (user.case.parent / f"later_{number}.png").write_bytes((user.case.parent / "frame.png").read_bytes())
    yield from user.open_case()
    user.plain_view()
    scene, files = bpy.context.scene, [{"name": f"later_{number}.png"} for number in (1, 2)]
    user.call("queue_frames", "EXEC_DEFAULT", True, directory=str(user.case.parent), files=files)
    assert len(queued.queue_of(scene)) == 3
    yield from pull(user)
    yield from user.key("PAGE_DOWN", user.middle(), alt=True)
    yield from user.until(lambda: queued.position(scene) == 1, "the next frame")
    yield from user.redraw()
    yield from pull(user)
    poses = {"1": from_scene.cam_from_mesh(scene).tolist()}
    (user.case.parent / "poses.json").write_text(json.dumps(poses))
    yield SETTLED_S
    os.kill(os.getpid(), signal.SIGKILL)


def pull(user):
    x, y = user.middle()
    yield from user.drag((x, y), (x + SHIFT_PX, y))
