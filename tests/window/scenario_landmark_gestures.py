"""Landmarks by mouse: pins, drags that are fine or cancelled, switched off and deleted, picks in other views."""

import bpy
import numpy as np
from bl_ext.user_default.oneframe.landmarks import solve
from bl_ext.user_default.oneframe.pipeline.blender.alignment import surface_object
from bl_ext.user_default.oneframe.pipeline.transforms import rigid, rotation_from_vector, transform_points
from bl_ext.user_default.oneframe.state import from_scene
from bl_ext.user_default.oneframe.state.landmarks import points_model
from bl_ext.user_default.oneframe.ui.frame_view import surface_point_at
from bl_ext.user_default.oneframe.ui.keymap import LANDMARK_TOOL

FEATURES = np.array([(170, 250), (330, 190), (800, 190), (860, 560), (460, 540)], float)


def scenario(user):
    yield from user.open_case()
    user.plain_view()
    true = user.pose
    points = np.array([surface_point_at(bpy.context.scene, pixel) for pixel in FEATURES])
    start = rigid(rotation_from_vector(np.radians([3.0, -2.5, 3.0])), [4.0, -3.0, 8.0]) @ true
    surface_object.set_pose(bpy.context.scene.oneframe.camera_object, bpy.context.scene.oneframe.surface, start)
    with user.context():
        bpy.ops.wm.tool_set_by_id(name=LANDMARK_TOOL)
        # at the rough pose some features lie outside the frame
        bpy.ops.oneframe.zoom_frame(factor=0.7)
        bpy.ops.ed.undo_push(message="rough pose")
    yield from user.redraw()
    yield from miss(user)
    yield from pull(user, points)
    yield from drag(user)
    yield from use_and_delete(user)
    yield from pick_elsewhere(user)


def miss(user):
    """A press beside surface and frame picks nothing, says so at the pointer, and leaves the keys their meaning."""
    surface = bpy.context.scene.oneframe.surface
    wireframes = [surface.display_type == "WIRE"]
    pixel = np.array([450.0, 735.0])
    assert surface_point_at(bpy.context.scene, pixel) is None
    outside = place(user, pixel)
    # a pin that began on the surface and ends outside is none either
    on_surface = place(user, FEATURES[2])
    for modifier, start in (({}, outside), ({"ctrl": True}, outside), ({"ctrl": True}, on_surface)):
        yield from user.drag(start, (outside[0] + 5, outside[1]), **modifier)
        yield from user.key("TWO")
        yield 0.3
        wireframes.append(bpy.context.scene.oneframe.surface.display_type == "WIRE")
        assert not entries(), modifier
    assert wireframes == [False, True, False, True], wireframes
    yield from user.key("TWO")


def pull(user, points):
    """Each pin brings its point to its pixel while the other points stay; one undo step each."""
    for count, (point, pixel) in enumerate(zip(points, FEATURES, strict=True), start=1):
        before = errors_px(user, points)
        yield from user.drag(place(user, seen(user, point[None])[0]), place(user, pixel), ctrl=True)
        yield from user.until(lambda number=count: len(entries()) == number, f"pin {count}")
        yield from user.redraw()
        user.facts[f"px after {count} pins"] = round(float(errors_px(user, points).mean()), 1)
        # the pointer is on whole screen pixels, at the press and at the release
        on_screen = errors_px(user, points)[:count] * user.frame_view.magnification
        assert on_screen.max() < 2.5, (count, before, on_screen)
    pose = user.pose
    yield from user.undo(lambda: len(entries()) == len(points) - 1, "a pin undone")
    yield from user.redo(lambda: len(entries()) == len(points), "a pin redone")
    yield from user.until(lambda: np.array_equal(user.pose, pose), "its pose redone")


def drag(user):
    """An image point follows the pointer and the pose follows it; Esc restores both; Shift is 10 times finer."""
    pixel, pose = pixel_of(1), user.pose
    at = place(user, pixel)
    yield from user.move(at)
    user.event("LEFTMOUSE", "PRESS", at)
    yield 0.1
    user.event("MOUSEMOVE", "NOTHING", (at[0] + 4, at[1] + 3))
    yield from user.until(lambda: not np.array_equal(pixel_of(1), pixel), "the image point to follow")
    yield from user.until(lambda: not np.array_equal(user.pose, pose), "the pose to follow")
    yield from user.redraw()
    yield 0.3
    user.event("ESC", "PRESS", at)
    user.event("ESC", "RELEASE", at)
    yield from user.until(lambda: np.array_equal(pixel_of(1), pixel), "the drag cancelled")
    user.event("LEFTMOUSE", "RELEASE", at)
    yield from user.until(lambda: np.array_equal(user.pose, pose), "the pose restored")
    yield 0.2

    user.event("MOUSEMOVE", "NOTHING", at)
    user.event("LEFTMOUSE", "PRESS", at)
    yield 0.1
    user.event("LEFT_SHIFT", "PRESS", at, shift=True)
    user.event("MOUSEMOVE", "NOTHING", (at[0] + 20, at[1]), shift=True)
    yield 0.2
    user.event("LEFT_SHIFT", "RELEASE", at)
    user.event("LEFTMOUSE", "RELEASE", (at[0] + 20, at[1]))
    yield from user.until(lambda: not np.array_equal(pixel_of(1), pixel), "the fine drag")
    moved_px = (pixel_of(1) - pixel) * user.frame_view.scale
    assert np.allclose(moved_px, [2.0, 0.0], atol=0.05), moved_px


def use_and_delete(user):
    at = place(user, pixel_of(2))
    yield from user.click(at, alt=True)
    yield from user.until(lambda: not entries()[2].enabled, "the landmark to be disabled")
    yield from user.key("X", place(user, pixel_of(2)))
    yield from user.until(lambda: len(entries()) == len(FEATURES) - 1, "the landmark deleted")
    objects = len(bpy.data.objects)
    yield from user.key("X", place(user, np.array([600.0, 400.0])))
    yield 0.3
    assert (len(entries()), len(bpy.data.objects)) == (len(FEATURES) - 1, objects)


def pick_elsewhere(user):
    """A click in another view picks a surface point; the next click in the frame picks its image point."""
    count = len(entries())
    user.view.view_perspective = "PERSP"
    with user.context():
        bpy.ops.object.select_all(action="DESELECT")
        bpy.context.scene.oneframe.surface.select_set(True)
        bpy.ops.view3d.view_selected()
    yield from user.redraw()
    yield from user.click(user.middle())
    yield from user.until(lambda: len(entries()) == count + 1, "a point picked in the other view")
    assert (entries()[-1].has_point, entries()[-1].has_pixel) == (True, False)
    yield from user.picture("3_other_view")
    user.view.view_perspective = "CAMERA"
    yield from user.redraw()
    yield from user.click(place(user, seen(user, points_model(bpy.context.scene)[-1:])[0]))
    yield from user.until(lambda: entries()[-1].has_pixel, "its image point")
    assert len(entries()) == count + 1
    assert solve.solution(bpy.context.scene).estimate is not None


def entries():
    return bpy.context.scene.oneframe.landmarks


def pixel_of(index):
    return np.array(entries()[index].pixel, float)


def place(user, pixel):
    """The screen pixel of the window that shows a pixel of the frame."""
    region, at = user.region(), user.frame_view.region_from_px(pixel)
    return region.x + float(np.floor(at[0])), region.y + float(np.floor(at[1]))


def seen(user, points):
    pose = user.pose
    return from_scene.camera(bpy.context.scene).project(transform_points(pose, points))


def errors_px(user, points):
    return np.linalg.norm(seen(user, points) - FEATURES, axis=1)
