"""A queue whose Blender is killed, left by its cross, and started once more: the history has every pose in between.

Which of the three starts this is, ``poses.json`` beside the case tells: it holds the poses that the next one finds.
"""

import json
import os
import signal

import bpy
import numpy as np
import x11
from bl_ext.user_default.oneframe.pipeline.case.case_file import read_case
from bl_ext.user_default.oneframe.pipeline.case.case_history import earlier_cases
from bl_ext.user_default.oneframe.setup import history, queued
from bl_ext.user_default.oneframe.setup.case_in_scene import unsaved_parts
from bl_ext.user_default.oneframe.state import from_scene
from bl_ext.user_default.oneframe.ui.keymap import PIN_TOOL, active_tool

SHIFT_PX, SETTLED_S, ENDS_S = 12, 1.0, 20


def scenario(user):
    file = user.case.parent / "poses.json"
    poses = json.loads(file.read_text()) if file.exists() else []
    yield from (killed, left_by_cross, read_back)[len(poses)](user, poses)


def leave_behind(user, poses):
    (user.case.parent / "poses.json").write_text(json.dumps([*poses, pose().tolist()]))


def case_of(user, name):
    return user.case.parent / "queue" / name / "case.toml"


def killed(user, poses):
    """The first frame of a queue is pulled and checked, the second one only pulled, a second before the kill."""
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
    leave_behind(user, poses)
    yield SETTLED_S
    os.kill(os.getpid(), signal.SIGKILL)


def left_by_cross(user, poses):
    """What the kill left comes back; a checked pose is replaced after a question only; File > New, then the cross."""
    first, second = case_of(user, "frame"), case_of(user, "later_1")
    text = second.read_bytes()
    yield from user.open_case(second)
    user.plain_view()
    scene = bpy.context.scene
    yield from user.open_sidebar("OneFrame")
    yield from user.redraw()
    yield from user.picture("1_in_the_history")
    assert "not in the file" in history.later_text(scene)
    user.call("restore", "INVOKE_DEFAULT", True)
    assert np.allclose(pose(), poses[0], atol=1e-9)
    assert (second.read_bytes(), unsaved_parts(scene)) == (text, ("pose", "landmarks"))

    # F, then on, at the checked frame: a question, Escape keeps its pose, Replace keeps it in the history
    yield from user.key("PAGE_UP", user.middle())
    yield from user.until(lambda: queued.position(bpy.context.scene) == 0, "the frame before")
    assert np.allclose(read_case(second).cam_from_mesh, poses[0], atol=1e-9)
    yield from user.redraw()
    checked, before = first.read_bytes(), pose()
    yield from user.key("F", user.middle())
    yield from user.until(lambda: not np.array_equal(pose(), before), "a pose that was found")
    for key, place, check in (("ESC", 0, True), ("R", 1, False)):
        # the first time it keeps the previewed pose too
        yield from user.key("PAGE_DOWN", user.middle())
        yield 0.7
        yield from user.picture("2_question")
        yield from user.key(key)
        yield from user.until(lambda place=place: queued.position(bpy.context.scene) == place, "the answer")
        yield 0.5
        assert (first.read_bytes() == checked) == check
    assert read_case(first).alignment.method == "refined"
    assert any(each.case.alignment.checked for each in earlier_cases(first))

    # File > New at once: no question, and no pose is lost
    yield from user.redraw()
    yield from pull(user)
    pulled = pose()
    bpy.ops.wm.read_homefile(use_factory_startup=True)
    yield 0.5
    yield from user.open_case(second)
    assert np.allclose(read_case(second).cam_from_mesh, poses[0], atol=1e-9)
    assert np.allclose(earlier_cases(second)[0].case.cam_from_mesh, pulled, atol=1e-9)
    user.plain_view()
    user.call("restore", "INVOKE_DEFAULT", True)
    assert np.allclose(pose(), pulled, atol=1e-9)
    # nothing swallows keys
    yield from user.redraw()
    yield from user.key("RIGHT_ARROW", user.middle())
    yield from user.until(lambda: not np.allclose(pose(), pulled, atol=1e-9), "a nudge")
    yield from pull(user)
    leave_behind(user, poses)
    # the driver has changed the preferences, which Blender would save with the question switched off
    bpy.context.preferences.is_dirty = False
    yield SETTLED_S
    # all of it is in the history: Blender does not ask about Untitled.blend
    x11.click_cross()
    yield 0.7
    yield from user.picture("3_not_ended")
    yield ENDS_S


def read_back(user, poses):
    """The pose of the cross is there, is restored, saved and checked."""
    second = case_of(user, "later_1")
    yield from user.open_case(second)
    user.call("restore", "INVOKE_DEFAULT", True)
    assert np.allclose(pose(), poses[1], atol=1e-9)
    yield from user.key("PAGE_DOWN", user.middle(), alt=True)
    yield from user.until(lambda: read_case(second).alignment.checked, "the checked pose in its file")
    assert np.allclose(read_case(second).cam_from_mesh, poses[1], atol=1e-9)


def pull(user):
    x, y = user.middle()
    yield from user.drag((x, y), (x + SHIFT_PX, y + SHIFT_PX))


def pose():
    return from_scene.cam_from_mesh(bpy.context.scene)
