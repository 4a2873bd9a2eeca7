"""In the camera view, keys and wheel show the right thing and move nothing; a held key and a drag move the surface.

By the right distance, and each is one undo step; other keys are Blender's.
"""

import bpy
import numpy as np
from bl_ext.user_default.oneframe.state import from_scene
from bl_ext.user_default.oneframe.state.pose import pivot_of
from bl_ext.user_default.oneframe.ui.keymap import MOVE_TOOL

WINDOW = 1024, 640
STILL_PX = 1.0
"""How far the frame may move under the pointer while the wheel is turned, pixels of the screen."""


def scenario(user):
    yield from user.open_case()
    user.plain_view()
    yield from see(user)
    yield from move(user)


def see(user):
    scene, space = bpy.context.scene, user.area.spaces.active
    space.show_gizmo, space.overlay.show_text = False, False
    bpy.context.view_layer.update()
    before = placed(scene)
    yield from zoom(user, scene)
    yield from keys(user, scene)
    assert (placed(scene) == before).all()


def placed(scene):
    return np.array([scene.oneframe.camera_object.matrix_world, scene.oneframe.surface.matrix_world])


def zoom(user, scene):
    """Zoom with the wheel, also with the view locked to the camera, which must not move then."""
    region = user.region()
    corner = np.array([region.x, region.y])
    moved, largest = [], 0.0
    for lock, fraction, steps in ((False, (0.35, 0.6), (15, 8)), (True, (0.6, 0.4), (6, 3))):
        user.area.spaces.active.lock_camera = lock
        yield from user.key("HOME", user.middle())
        yield from user.move(tuple(np.round(corner + np.array(fraction) * [region.width, region.height])))
        place = np.round(user._place)
        under = user.frame_view.px_from_region(place - corner)
        for kind in ["WHEELUPMOUSE"] * steps[0] + ["WHEELDOWNMOUSE"] * steps[1]:
            user.event(kind, "PRESS", tuple(place))
            yield 0.06
            view = user.frame_view
            largest = max(largest, view.magnification)
            moved.append(np.abs(view.region_from_px(under) - (place - corner)).max())
    user.area.spaces.active.lock_camera = False
    user.facts["zoom"] = {"largest": round(largest, 1), "moved_px": round(float(max(moved)), 4)}
    assert max(moved) < STILL_PX
    assert largest > 16
    yield from user.key("SEVEN")
    yield from user.until(lambda: abs(user.frame_view.magnification - 1) < 1e-4, "1 : 1")
    yield from user.key("HOME")
    yield from user.until(lambda: abs(user.frame_view.magnification - 1) > 1e-3, "the whole frame")


def keys(user, scene):
    view = scene.oneframe_view
    yield from user.move(user.middle())
    for key, state in (
        ("ONE", lambda: round(view.opacity, 1) == 0.6),
        ("TWO", lambda: scene.oneframe.surface.display_type == "WIRE"),
        ("THREE", lambda: view.contour),
    ):
        assert not state(), key
        yield from user.key(key)
        yield from user.until(state, f"the effect of key {key}")
    for key in ("THREE", "TWO"):
        yield from user.key(key)
    view.opacity = 0.0
    yield from user.redraw()


def move(user):
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
