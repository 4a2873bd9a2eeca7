"""A stray key over a checked pose: a question before it is saved over, Escape keeps it, and undo brings it back."""

import bpy
import numpy as np

bpy.ops.preferences.addon_enable(module="bl_ext.user_default.oneframe")

from bl_ext.user_default.oneframe.case_queue import queued
from bl_ext.user_default.oneframe.pipeline.case.case_file import read_case
from bl_ext.user_default.oneframe.pipeline.case.case_history import earlier_poses
from bl_ext.user_default.oneframe.setup import autosave
from bl_ext.user_default.oneframe.state import from_scene


def scenario(user):
    yield from user.open_case()
    (user.folder / "later.png").write_bytes((user.case.parent / "frame.png").read_bytes())
    with user.context():
        files = [{"name": "later.png"}]
        bpy.ops.oneframe.queue_frames("EXEC_DEFAULT", True, directory=str(user.folder), files=files)
    path = queued.queue_of(bpy.context.scene)[0].path
    yield from user.key("PAGE_DOWN", user.middle(), alt=True)
    yield from user.until(lambda: at() == 1, "the next frame")
    yield from user.key("PAGE_UP", user.middle())
    yield from user.until(lambda: at() == 0, "the frame before")
    checked, text = pose(), path.read_bytes()
    assert "checked" in read_case(path).alignment

    x, y = user.middle()
    yield from user.drag((x, y), (x + 10, y))
    moved = pose()
    assert not np.array_equal(moved, checked)
    for key, alt in (("PAGE_DOWN", False), ("PAGE_DOWN", True)):
        yield from user.key(key, user.middle(), alt=alt)
        yield 0.7
        yield from user.picture(f"1_question_{alt}")
        yield from user.key("ESC")
        yield 0.5
        assert (at(), path.read_bytes()) == (0, text)
    yield from user.key("PAGE_DOWN", user.middle())
    yield 0.7
    yield from user.key("R")
    yield from user.until(lambda: at() == 1, "the next frame after Replace")
    assert read_case(path).alignment["method"] == "pins"
    assert "checked" in earlier_poses(path)[0].alignment

    # undo: the file is as it was, and what was saved is not lost
    yield from user.key("Z", user.middle(), ctrl=True)
    yield from user.until(lambda: at() == 0, "the frame before, by undo")
    yield from user.picture("2_undone")
    assert path.read_bytes() == text
    assert not earlier_poses(path)
    assert np.allclose(pose(), moved, atol=1e-9)
    yield autosave.PERIOD_S + 1
    assert autosave.aside(path).exists()
    yield from user.key("Z", user.middle(), ctrl=True)
    yield from user.until(lambda: np.array_equal(pose(), checked), "the checked pose, by undo")
    yield autosave.PERIOD_S + 1
    assert not autosave.aside(path).exists()
    assert path.read_bytes() == text


def at():
    return queued.position(bpy.context.scene)


def pose():
    return from_scene.cam_from_model(bpy.context.scene)
