"""Tests the simulated user on Blender's own interface: find, type, drag, undo, choose a file, hit a pixel."""

import bpy
from bpy_extras.object_utils import world_to_camera_view
from mathutils import Vector

LOCATION_X = 'objects["Cube"].location[0]'


def scenario(user):
    bpy.ops.preferences.addon_enable(module="bl_ext.user_default.oneframe")
    yield from user.open_sidebar("Item")
    yield from user.type_into(LOCATION_X, "-1.25")
    yield from user.until(lambda: cube_x() == -1.25, "the number typed")
    start = yield from user.find(LOCATION_X)
    yield from user.drag(start, (start[0] + 40, start[1]))
    yield from user.until(lambda: cube_x() > -1.2, "the number dragged up")
    yield from user.key("Z", user.middle(), ctrl=True)
    yield from user.until(lambda: cube_x() == -1.25, "the drag undone")

    region, x, y = user.region(), *user.of_point(bpy.data.objects["Cube"].location)
    yield from user.click((region.x + 100, region.y + 60))
    yield from user.until(lambda: not bpy.data.objects["Cube"].select_get(), "nothing selected")
    yield from user.drag((x - 80, y - 80), (x + 80, y + 80))
    yield from user.until(lambda: [found.name for found in bpy.context.selected_objects] == ["Cube"], "a box selection")
    yield from user.key("G", (x, y))
    yield from user.key("X")
    yield from user.type_text("3")
    yield from user.key("RET")
    yield from user.until(lambda: cube_x() == 1.75, "the cube moved by 3")

    yield from user.key("NUMPAD_0", user.middle())
    yield from user.until(lambda: user.view.view_perspective == "CAMERA", "the camera's view")
    yield 0.5
    yield from user.redraw()
    for corner in bpy.data.objects["Cube"].bound_box:
        check_pixel(user, bpy.data.objects["Cube"].matrix_world @ Vector(corner))
    yield from user.picture("camera")

    saved = user.folder / "cube.blend"
    bpy.ops.wm.save_as_mainfile(filepath=str(saved))
    bpy.data.objects["Cube"].location.x = 7
    bpy.ops.wm.open_mainfile(filepath=str(saved))
    yield from user.redraw()
    assert cube_x() == 1.75
    with user.context():
        bpy.ops.image.open("INVOKE_DEFAULT")
    yield from user.choose_file(user.case.parent / "frame.png")
    yield from user.until(lambda: "frame.png" in bpy.data.images, "the image opened")


def cube_x() -> float:
    return round(bpy.data.objects["Cube"].location.x, 6)


def check_pixel(user, point) -> None:
    """A point of the world and its pixel in the camera's image are at the same place in the window."""
    scene = bpy.context.scene
    across, up, _ = world_to_camera_view(scene, scene.camera, point)
    pixel = across * scene.render.resolution_x - 0.5, (1 - up) * scene.render.resolution_y - 0.5
    assert all(abs(a - b) < 0.05 for a, b in zip(user.of_pixel(*pixel), user.of_point(point), strict=True))
