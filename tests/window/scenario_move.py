"""A held key and a drag move the surface by the right distance; each is one undo step; other keys are Blender's."""

import bpy
import numpy as np
from bl_ext.user_default.oneframe.state import from_scene
from bl_ext.user_default.oneframe.state.pose import pivot_of
from bl_ext.user_default.oneframe.ui.keymap import MOVE_TOOL


def scenario(user):
    yield from user.open_case()
    user.plain_view()
    yield from user.take_tool(MOVE_TOOL)
    start = user.pose

    yield from user.move(user.middle())
    for _ in range(3):
        # a held key repeats its press
        user.event("RIGHT_ARROW", "PRESS")
        yield 0.1
    user.event("RIGHT_ARROW", "RELEASE")
    yield from user.until(lambda: moved(user, start)[0] > 2.5, "three steps to the right")
    assert np.allclose(moved(user, start), [3, 0], atol=1e-6)
    yield from user.undo(lambda: np.array_equal(user.pose, start), "all of them undone at once")

    middle = user.middle()
    for mode, held, path, expected in (
        ("shift", {}, (40, -24), (40, 24)),
        ("depth", {"ctrl": True, "alt": True}, (0, 30), (0, 0)),
    ):
        per_px = user.frame_view.magnification
        yield from user.drag(middle, (middle[0] + path[0], middle[1] + path[1]), **held)
        yield from user.until(lambda: not np.array_equal(user.pose, start), f"the surface dragged ({mode})")
        yield from user.redraw()
        # the pointer is on whole pixels of the window
        assert np.allclose(moved(user, start), np.array(expected) / per_px, atol=1.5 / per_px), (
            mode,
            moved(user, start),
        )
        if mode == "depth":
            assert user.pose[2, 3] > start[2, 3], "dragged up, the surface moves away"
        yield from user.undo(lambda: np.array_equal(user.pose, start), f"the drag undone ({mode})")

    yield from user.move(middle)
    user.event("LEFTMOUSE", "PRESS", middle)
    yield 0.1
    for step in range(1, 5):
        user.event("MOUSEMOVE", "NOTHING", (middle[0] + 10 * step, middle[1]))
        yield 0.1
    yield from user.until(lambda: not np.array_equal(user.pose, start), "the surface under the pointer")
    yield from user.key("ESC")
    yield from user.until(lambda: np.array_equal(user.pose, start), "Esc to cancel the drag")
    user.event("LEFTMOUSE", "RELEASE")
    yield 0.2

    yield from user.key("COMMA", user.middle(), alt=True)
    yield from user.until(lambda: not np.array_equal(user.pose, start), "10 px of roll", 20)
    start = user.pose
    # in Edit mode the keys are Blender's, and the pose stays
    bpy.context.view_layer.objects.active = bpy.context.scene.oneframe.surface
    with user.context():
        bpy.ops.object.mode_set(mode="EDIT")
    yield from user.key("RIGHT_ARROW", user.middle())
    with user.context():
        bpy.ops.object.mode_set(mode="OBJECT")
    assert np.array_equal(user.pose, start)


def moved(user, start):
    """``(2,)`` movement of the pivot, pixels of the frame."""
    scene = bpy.context.scene
    pivot, _ = pivot_of(scene)
    camera = from_scene.camera(scene)
    before, after = (camera.project((each[:3, :3] @ pivot + each[:3, 3])[None])[0] for each in (start, user.pose))
    return after - before
