"""The add-on works in a workspace and a scene of its own; the user's come back as they were."""

import bpy
import numpy as np
import x11
from mathutils import Vector

PACKAGE = "bl_ext.user_default.oneframe"
bpy.ops.preferences.addon_enable(module=PACKAGE)

from bl_ext.user_default.oneframe.pipeline.case.case_file import read_case
from bl_ext.user_default.oneframe.pipeline.images.image_reader import read_image
from bl_ext.user_default.oneframe.pipeline.images.pixel_values import to_uint8
from bl_ext.user_default.oneframe.ui.frame_view import FrameView
from bl_ext.user_default.oneframe.ui.keymap import PIN_TOOL, active_tool
from bl_ext.user_default.oneframe.view.zoom import free_rectangle


def scenario(user):
    shading = user.area.spaces.active.shading
    shading.color_type, shading.light = "RANDOM", "MATCAP"
    before, known = users_state(user), set(workspaces())
    bpy.ops.ed.undo_push(message="the user's file")
    bpy.ops.wm.save_as_mainfile(filepath=str(user.folder / "users.blend"), copy=True)

    # a new file, frame, typed K, surface: the default cube hides nothing
    with user.context():
        bpy.ops.oneframe.load_frame("EXEC_DEFAULT", True, filepath=str(user.case.parent / "frame.png"))
    yield from user.at_workbench()
    assert_frame_is_seen(user)
    true = read_case(user.case).camera
    typed = bpy.context.scene.oneframe.camera
    typed.fx = typed.fy = repr(true.fx)
    with user.context():
        bpy.ops.oneframe.set_camera("EXEC_DEFAULT", True)
    yield 0.5
    yield from user.redraw()
    assert_frame_is_free(user)
    with user.context():
        bpy.ops.oneframe.load_surface("EXEC_DEFAULT", True, filepath=str(user.case.parent / "surface.ply"))
    yield from user.redraw()
    yield from user.open_case()
    assert len(bpy.data.scenes) == 2
    assert_frame_is_free(user)
    with user.context():
        assert active_tool(bpy.context) == PIN_TOOL

    yield from orbit(user)
    yield from side_by_side(user)

    # leave by the tab, by undo, by disabling
    own = user.window.workspace
    user.window.workspace = bpy.data.workspaces["Layout"]
    yield from user.until(lambda: user.window.scene.name == "Scene", "the user's scene behind their tab")
    assert users_state(user) == before
    user.window.workspace = own
    yield from user.at_workbench()
    for _ in range(4):
        with user.context():
            bpy.ops.ed.undo()
        yield 0.3
    yield from user.until(lambda: user.window.workspace.name == "Layout", "the user's tab after undo")
    assert users_state(user) == before
    with user.context():
        bpy.ops.ed.redo()
    yield from user.at_workbench()

    # another file, with the interface as it is
    with user.context():
        bpy.ops.wm.open_mainfile(filepath=str(user.folder / "users.blend"), load_ui=False)
    yield from user.until(lambda: set(workspaces()) == known, "the workspace to go with its file")
    yield from user.open_case()
    bpy.ops.preferences.addon_disable(module=PACKAGE)
    yield from user.until(lambda: set(workspaces()) == known, "the workspace removed")
    yield from user.until(lambda: user.window.scene.name == "Scene", "the user's scene")
    yield from user.redraw()
    assert users_state(user) == before


def workspaces():
    return [workspace.name for workspace in bpy.data.workspaces]


def assert_frame_is_seen(user):
    """The frame fills the free part of the view before any camera shows it."""
    with user.context():
        low, high = free_rectangle(user.area)
    image = to_uint8(read_image(user.case.parent / "frame.png")[0])
    scale, region = float(np.min((high - low) / image.shape[1::-1])), user.region()
    places = np.random.default_rng(1).uniform(0.2, 0.8, (500, 2))
    at = (low + high) / 2 + (places - 0.5) * [1, -1] * scale * image.shape[1::-1] + [region.x, region.y]
    columns, rows = np.round([at[:, 0], user.window.height - at[:, 1]]).astype(int)
    u, v = (places * image.shape[1::-1]).astype(int).T
    off = np.abs(x11.capture()[rows, columns].astype(float) - image[v, u])
    assert np.median(off) < 12, np.median(off)


def orbit(user):
    """The first orbit keeps the surface in view, about as large as it was."""
    x, y = user.middle()
    yield from user.drag((x, y), (x + 60, y + 30), button="MIDDLEMOUSE")
    yield from user.until(lambda: user.view.view_perspective == "PERSP", "the view to leave the camera")
    yield from user.redraw()
    assert user.view.view_distance > 100
    corners = [bpy.context.scene.oneframe.surface.matrix_world @ v for v in corners_of(bpy.context.scene)]
    region = user.region()
    seen = np.array([user.of_point(corner) for corner in corners]) - [region.x, region.y]
    assert (np.ptp(seen, axis=0) > 0.3 * region.height).all()
    assert (np.abs(seen.mean(axis=0) - [region.width / 2, region.height / 2]) < 0.35 * region.width).all()
    with user.context():
        bpy.ops.oneframe.show_frame()
    yield 0.3
    yield from user.redraw()


def corners_of(scene):
    return [Vector(corner) for corner in scene.oneframe.surface.bound_box]


def side_by_side(user):
    """Two pictures of one size beside one sidebar; the same button closes the second."""
    with user.context():
        bpy.ops.oneframe.side_by_side()
    yield 0.5
    views = sorted((area for area in user.window.screen.areas if area.type == "VIEW_3D"), key=lambda area: area.x)
    yield from user.picture("side_by_side")
    assert [area.spaces.active.show_region_ui for area in views] == [True, False]
    sidebar = user.region("UI", views[0]).width
    assert abs(views[0].width - sidebar - views[1].width) < 20
    with bpy.context.temp_override(window=user.window, area=views[0], region=user.region("UI", views[0])):
        bpy.ops.oneframe.side_by_side()
    yield 0.5
    yield from user.redraw()
    assert len([area for area in user.window.screen.areas if area.type == "VIEW_3D"]) == 1
    assert user.area.spaces.active.show_region_ui
    assert_frame_is_free(user)


def assert_frame_is_free(user):
    """The whole frame lies beside toolbar, sidebar and headers, and fills what they leave."""
    view = FrameView.of(bpy.context.scene, user.region(), user.view)
    width, height = view.camera.size_wh
    low, high = free_rectangle(user.area)
    left_low, right_high = view.region_from_px([[-0.5, height - 0.5], [width - 0.5, -0.5]])
    assert (left_low >= low - 1).all(), (left_low, low)
    assert (right_high <= high + 1).all(), (right_high, high)
    assert ((right_high - left_low) / (high - low)).max() > 0.9
    assert user.region("UI").x - user.region().x >= right_high[0] - 1


def users_state(user):
    """What the user sees and has set in their scene, their first workspace and their world."""
    scene = bpy.data.scenes["Scene"]
    screen = bpy.data.workspaces["Layout"].screens[0]
    space = next(area.spaces.active for area in screen.areas if area.type == "VIEW_3D")
    view = space.region_3d
    return (
        sorted(found.name for found in scene.objects),
        (scene.render.resolution_x, scene.render.resolution_y, scene.unit_settings.scale_length),
        (scene.camera.name, scene.world.name, scene.view_settings.view_transform),
        [area.type for area in screen.areas],
        (space.shading.type, space.shading.light, space.shading.color_type, space.lens, space.clip_start),
        (view.view_perspective, tuple(view.view_location), view.view_distance, tuple(view.view_rotation)),
        (space.show_region_ui, space.overlay.show_floor, space.lock_camera, space.show_region_toolbar),
        bpy.data.workspaces["Layout"].tools.from_space_view3d_mode("OBJECT", create=False).idname,
    )
