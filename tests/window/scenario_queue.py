"""A queue by keys: each frame starts at the pose before; two keys or drags a frame."""

import bpy
import numpy as np
from bl_ext.user_default.oneframe.case_queue import queued
from bl_ext.user_default.oneframe.state import from_scene
from bl_ext.user_default.oneframe.ui.keymap import PIN_TOOL, active_tool

FRAMES, SHIFT_PX = 2, 12


def scenario(user):
    yield from user.open_case()
    user.plain_view()
    scene = bpy.context.scene
    yield from user.open_sidebar("OneFrame")
    files = [{"name": f"taken_{number}.png"} for number in range(1, FRAMES)]
    for file in files:
        (user.folder / file["name"]).write_bytes((user.case.parent / "frame.png").read_bytes())
    user.call("queue_frames", "EXEC_DEFAULT", True, directory=str(user.folder), files=files)
    entries, zoom = queued.queue_of(scene), user.view.view_camera_zoom
    assert len(entries) == FRAMES
    yield from user.redraw()

    for number in range(FRAMES):
        yield from pull(user)
        pulled = pose()
        # a drag and a key for each frame
        yield from user.key("PAGE_DOWN", user.middle(), alt=True)
        yield from user.until(lambda now=number: checked(scene) == now + 1, "the frame to be checked")
        if number + 1 < FRAMES:
            yield from user.until(lambda now=number: at() == now + 1, "the next frame")
            assert np.array_equal(pose(), pulled)
            assert len(scene.oneframe.landmarks) == 0
            yield from user.picture("2_next_frame")
        yield from user.redraw()
        assert user.view.view_camera_zoom == zoom
        with user.context():
            assert active_tool(bpy.context) == PIN_TOOL


def pull(user):
    x, y = user.middle()
    yield from user.drag((x, y), (x + SHIFT_PX, y))


def at():
    return queued.position(bpy.context.scene)


def checked(scene):
    return [entry.state for entry in queued.queue_of(scene)].count("checked")


def pose():
    return from_scene.cam_from_model(bpy.context.scene)
