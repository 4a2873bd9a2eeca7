"""Keys and wheel in the camera view show the right thing, and the pose stays the same to the last bit."""

import bpy
import numpy as np

WINDOW = 1024, 640
STILL_PX = 1.0
"""How far the frame may move under the pointer while the wheel is turned, pixels of the screen."""


def scenario(user):
    yield from user.open_case()
    scene, space = bpy.context.scene, user.area.spaces.active
    space.show_gizmo, space.overlay.show_text = False, False
    user.plain_view()
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
