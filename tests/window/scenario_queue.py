"""A queue by keys: each frame starts at the pose before; a stray key over a checked pose asks, undo takes it back."""

import bpy
import numpy as np
from bl_ext.user_default.oneframe.case_queue import queued
from bl_ext.user_default.oneframe.pipeline.case.case_file import read_case
from bl_ext.user_default.oneframe.pipeline.case.case_history import earlier_poses
from bl_ext.user_default.oneframe.setup import autosave
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
    yield from user.key("PAGE_UP", user.middle())
    yield from user.until(lambda: at() == FRAMES - 2, "the frame before")
    yield from over_a_checked_pose(user, entries[FRAMES - 2].path)


def over_a_checked_pose(user, path):
    """A question before hands replace it, Escape keeps it; undo after Replace brings pose, file and history back."""
    here, kept, text = at(), pose(), path.read_bytes()
    x, y = user.middle()
    yield from user.drag((x + SHIFT_PX, y), (x + 2 * SHIFT_PX, y))  # the pin that the file has
    moved = pose()
    assert len(bpy.context.scene.oneframe.landmarks) == 1
    assert not np.array_equal(moved, kept)
    for alt in (False, True):
        yield from user.key("PAGE_DOWN", user.middle(), alt=alt)
        yield 0.7
        yield from user.key("ESC")
        yield 0.5
        assert (at(), path.read_bytes()) == (here, text)
    yield from user.key("PAGE_DOWN", user.middle())
    yield 0.7
    yield from user.picture("3_question")
    yield from user.key("R")
    yield from user.until(lambda: at() == here + 1, "the next frame after Replace")
    assert read_case(path).alignment.method == "pins"
    assert earlier_poses(path)[0].alignment.checked
    yield from user.undo(lambda: at() == here, "the frame before, by undo")
    assert path.read_bytes() == text
    assert np.allclose(pose(), moved, atol=1e-9)
    yield autosave.PERIOD_S + 1
    assert autosave.aside(path).exists()
    yield from user.undo(lambda: np.array_equal(pose(), kept), "the checked pose, by undo")
    yield autosave.PERIOD_S + 1
    assert not autosave.aside(path).exists()


def pull(user):
    x, y = user.middle()
    yield from user.drag((x, y), (x + SHIFT_PX, y))


def at():
    return queued.position(bpy.context.scene)


def checked(scene):
    return [entry.state for entry in queued.queue_of(scene)].count("checked")


def pose():
    return from_scene.cam_from_model(bpy.context.scene)
