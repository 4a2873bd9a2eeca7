"""What the kill left comes back; a checked pose is replaced after a question only; File > New, then the cross."""

import json

import bpy
import numpy as np
import x11
from bl_ext.user_default.oneframe.case_queue import queued
from bl_ext.user_default.oneframe.pipeline.case.case_file import read_case
from bl_ext.user_default.oneframe.pipeline.case.case_history import earlier_cases
from bl_ext.user_default.oneframe.setup import history
from bl_ext.user_default.oneframe.setup.case_in_scene import unsaved_parts
from bl_ext.user_default.oneframe.state import from_scene

SHIFT_PX, SETTLED_S = 10, 1.0
ENDS_S = 20


def scenario(user):
    first, second = (user.case.parent / "queue" / name / "case.toml" for name in ("frame", "later_1"))
    poses = json.loads((user.case.parent / "poses.json").read_text())
    text = second.read_bytes()
    yield from user.open_case(second)
    user.plain_view()
    scene = bpy.context.scene
    yield from user.open_sidebar("OneFrame")
    yield from user.redraw()
    yield from user.picture("1_in_the_history")
    assert "not in the file" in history.later_text(scene)
    user.call("restore", "INVOKE_DEFAULT", True)
    assert np.allclose(pose(), poses["1"], atol=1e-9)
    assert (second.read_bytes(), unsaved_parts(scene)) == (text, ("pose", "landmarks"))

    # F, Enter, PgDn on the checked frame: a question, Escape keeps its pose, Replace keeps it in the history
    yield from user.key("PAGE_UP", user.middle())
    yield from user.until(lambda: queued.position(bpy.context.scene) == 0, "the frame before")
    assert np.allclose(read_case(second).cam_from_mesh, poses["1"], atol=1e-9)
    yield from user.redraw()
    checked, before = first.read_bytes(), pose()
    yield from user.key("F", user.middle())
    yield from user.until(lambda: not np.array_equal(pose(), before), "a pose that was found")
    yield from user.key("RET")
    yield 0.5
    yield from user.key("PAGE_DOWN", user.middle())
    yield 0.7
    yield from user.picture("2_question")
    yield from user.key("ESC")
    yield 0.5
    assert (queued.position(bpy.context.scene), first.read_bytes()) == (0, checked)
    yield from user.key("PAGE_DOWN", user.middle())
    yield 0.7
    yield from user.key("R")
    yield from user.until(lambda: queued.position(bpy.context.scene) == 1, "the next frame after Replace")
    assert read_case(first).alignment.method == "refined"
    assert any(each.case.alignment.checked for each in earlier_cases(first))

    # File > New at once: no question, and no pose is lost
    yield from user.redraw()
    yield from pull(user)
    poses["2"] = pose().tolist()
    bpy.ops.wm.read_homefile(use_factory_startup=True)
    yield 0.5
    yield from user.open_case(second)
    assert np.allclose(read_case(second).cam_from_mesh, poses["1"], atol=1e-9)
    assert np.allclose(earlier_cases(second)[0].case.cam_from_mesh, poses["2"], atol=1e-9)
    user.plain_view()
    user.call("restore", "INVOKE_DEFAULT", True)
    assert np.allclose(pose(), poses["2"], atol=1e-9)
    # nothing swallows keys
    yield from user.redraw()
    yield from user.key("RIGHT_ARROW", user.middle())
    yield from user.until(lambda: not np.allclose(pose(), poses["2"], atol=1e-9), "a nudge")
    yield from pull(user)
    poses["2"] = pose().tolist()
    (user.case.parent / "poses.json").write_text(json.dumps(poses))
    # the driver has changed the preferences, which Blender would save with the question switched off
    bpy.context.preferences.is_dirty = False
    yield SETTLED_S
    # all of it is in the history: Blender does not ask about Untitled.blend
    x11.click_cross()
    yield 0.7
    yield from user.picture("3_not_ended")
    yield ENDS_S


def pull(user):
    x, y = user.middle()
    yield from user.drag((x, y), (x + SHIFT_PX, y + SHIFT_PX))


def pose():
    return from_scene.cam_from_mesh(bpy.context.scene)
