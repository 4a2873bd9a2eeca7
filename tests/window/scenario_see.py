"""Keys, wheel and loupe in the camera view show the right thing, and the pose stays the same to the last bit."""

import itertools
from pathlib import Path

import bpy
import numpy as np
import x11
from bl_ext.user_default.oneframe.landmarks import loupe
from bl_ext.user_default.oneframe.pipeline.images.image_reader import read_image
from bl_ext.user_default.oneframe.ui.frame_view import FrameView
from bl_ext.user_default.oneframe.ui.keymap import PIN_TOOL

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
    yield from compare(user, scene)
    yield from magnify(user, scene)
    assert (placed(scene) == before).all()


def placed(scene):
    return np.array([scene.oneframe.camera_object.matrix_world, scene.oneframe.surface.matrix_world])


def seen(user):
    return FrameView.of(bpy.context.scene, user.region(), user.view)


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
        under = seen(user).px_from_region(place - corner)
        for kind in ["WHEELUPMOUSE"] * steps[0] + ["WHEELDOWNMOUSE"] * steps[1]:
            user.event(kind, "PRESS", tuple(place))
            yield 0.06
            view = seen(user)
            largest = max(largest, view.magnification)
            moved.append(np.abs(view.region_from_px(under) - (place - corner)).max())
    user.area.spaces.active.lock_camera = False
    user.facts["zoom"] = {"largest": round(largest, 1), "moved_px": round(float(max(moved)), 4)}
    assert max(moved) < STILL_PX
    assert largest > 16
    yield from user.key("SEVEN")
    yield from user.until(lambda: abs(seen(user).magnification - 1) < 1e-4, "1 : 1")
    yield from user.key("HOME")
    yield from user.until(lambda: abs(seen(user).magnification - 1) > 1e-3, "the whole frame")


def keys(user, scene):
    view = scene.oneframe_view
    yield from user.move(user.middle())
    for key, state in (
        ("ONE", lambda: round(view.opacity, 1) == 0.6),
        ("TWO", lambda: view.wireframe),
        ("THREE", lambda: view.contour),
        ("FOUR", lambda: view.comparison == "BLINK"),
        ("FIVE", lambda: view.comparison == "SWIPE"),
        ("SIX", lambda: view.comparison == "DIFFERENCE"),
    ):
        assert not state(), key
        yield from user.key(key)
        yield from user.until(state, f"the effect of key {key}")
    for key in ("SIX", "THREE", "TWO"):
        yield from user.key(key)
    view.opacity = 0.0
    yield from user.redraw()


def compare(user, scene):
    view = scene.oneframe_view
    frame = shown(user)
    view.comparison, view.split = "SWIPE", 0.5
    yield from user.redraw()
    swiped = np.abs(shown(user) - frame).max(axis=2)
    middle = swiped.shape[1] // 2
    assert np.percentile(swiped[:, : middle - 20], 99.9) <= 3, "the frame is not shown as behind the camera"
    assert np.median(swiped[:, middle + 20 :]) > 10
    user.area.spaces.active.show_gizmo = True
    yield from user.redraw()
    grip = user.of_pixel(view.split * scene.render.resolution_x - 0.5, 0)[0], user.middle()[1]
    yield from user.drag(grip, (grip[0] + 100, grip[1]))
    wanted = 0.5 + 100 / seen(user).magnification / scene.render.resolution_x
    yield from user.until(lambda: abs(view.split - wanted) < 0.01, "the line to follow the grip")
    user.area.spaces.active.show_gizmo = False
    view.comparison = "BLINK"
    yield from user.redraw()
    for other in (True, False, True, False):
        yield from user.until(
            lambda other=other: (np.median(np.abs(shown(user) - frame)) > 5) == other, "the view to blink"
        )
    view.comparison, view.contour = "NONE", True
    yield from user.redraw()
    lines = np.abs(shown(user) - frame).max(axis=2) > 40
    user.facts["contour"] = round(float(lines.mean()), 4)
    assert 0.002 < lines.mean() < 0.2
    view.contour = False
    yield from user.redraw()


def shown(user):
    """The middle of the frame in the view, float RGB, top row first."""
    region = user.region()
    picture = x11.capture()[::-1][region.y : region.y + region.height, region.x : region.x + region.width]
    width, height = seen(user).camera.size_wh
    low, high = seen(user).region_from_px([[0.2 * width, 0.8 * height], [0.8 * width, 0.2 * height]]).astype(int)
    return picture[low[1] : high[1], low[0] : high[0]][::-1].astype(float)


def magnify(user, scene):
    """The loupe shows the file's picture, enlarged about exactly the pixel under the pointer."""
    yield from user.take_tool(loupe.TOOL)
    image, _ = read_image(Path(bpy.path.abspath(scene.oneframe.frame_path)))
    size = loupe.size_in(user.area)
    region, best = user.region(), []
    for pixel in ((300.0, 300.0), (420.0, 500.0)):
        yield from user.move(user.of_pixel(*pixel))
        yield from user.redraw()
        yield 0.3
        pointer = np.round(user._place) + 0.5 - np.array([region.x, region.y])
        left, below = map(int, loupe.corner(user.area, pointer, size, []))
        window = x11.capture()[::-1].astype(float)[region.y + below :, region.x + left :][:size, :size]
        y, x = (np.mgrid[:size, :size] + 0.5 - size / 2) / loupe.MAGNIFICATION
        at = seen(user).px_from_region(pointer)
        errors = {}
        for dx, dy in itertools.product((-0.5, -0.25, 0.0, 0.25, 0.5), repeat=2):
            expected = 255 * bilinear(image, at[0] + dx + x, at[1] + dy - y)
            # the cross-hair covers few enough pixels for a median
            errors[dx, dy] = float(np.median(np.abs(expected - window)))
        best.append((min(errors, key=errors.get), round(errors[0.0, 0.0], 2)))
    yield from user.picture("see_loupe")
    user.facts["loupe"] = best
    assert all(shift == (0.0, 0.0) and error < 2 for shift, error in best), best
    yield from in_a_second_window(user)
    yield from user.take_tool(PIN_TOOL)


def in_a_second_window(user):
    """The loupe is drawn there too: its failures end up in Blender's output, which is checked."""
    bpy.context.scene.oneframe_view.contour = True
    yield from user.move(user.of_pixel(400.0, 300.0))
    yield from user.redraw()
    with user.context():
        bpy.ops.wm.window_new_main()
    second = bpy.context.window_manager.windows[1]
    yield 0.5
    for step in range(4):
        second.event_simulate("MOUSEMOVE", "NOTHING", x=second.width // 3 + 5 * step, y=second.height // 2)
        for area in second.screen.areas:
            area.tag_redraw()
        yield 0.3
    with bpy.context.temp_override(window=second):
        bpy.ops.wm.window_close()
    bpy.context.scene.oneframe_view.contour = False
    yield from user.redraw()


def bilinear(image, u, v):
    """(..., 3) values of an image between its pixels' centres."""
    column, row = np.floor(u).astype(int), np.floor(v).astype(int)
    right, down = (u - column)[..., None], (v - row)[..., None]
    upper = image[row, column] * (1 - right) + image[row, column + 1] * right
    lower = image[row + 1, column] * (1 - right) + image[row + 1, column + 1] * right
    return upper * (1 - down) + lower * down
