"""A queue: frames are checked, one in the middle is being aligned when Blender is ended by its cross."""

import json

import bpy
import x11
from bl_ext.user_default.oneframe.case_queue import queued
from bl_ext.user_default.oneframe.setup import autosave
from bl_ext.user_default.oneframe.state import from_scene

FRAMES = 3
SHIFT_PX = 14


def scenario(user):
    yield from user.open_case()
    scene = bpy.context.scene
    files = [{"name": f"later_{number:02}.png"} for number in range(1, FRAMES)]
    for file in files:
        (user.folder / file["name"]).write_bytes((user.case.parent / "frame.png").read_bytes())
    user.call("queue_frames", "EXEC_DEFAULT", True, directory=str(user.folder), files=files)
    assert len(queued.queue_of(scene)) == FRAMES
    # what is kept at the end, it alone
    bpy.app.timers.unregister(autosave._tick)
    poses = {}
    middle = FRAMES // 2
    for number in range(middle + 1):
        entry = queued.queue_of(scene)[number]
        x, y = user.middle()
        yield from user.drag((x, y), (x + SHIFT_PX, y))
        poses[str(entry.path)] = from_scene.cam_from_mesh(scene).tolist()
        if number < middle:
            yield from user.key("PAGE_DOWN", user.middle(), alt=True)
            yield from user.until(lambda now=number: queued.position(scene) == now + 1, "the next frame")
    (user.folder / "poses.json").write_text(json.dumps(poses))
    x11.click_cross()
    yield 0.7
    yield from user.picture("1_quitting")
    yield from user.key("D")
    yield 20
