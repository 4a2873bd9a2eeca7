"""The add-on works in a workspace and a scene of its own; the user's come back as they were."""

import bpy
from bl_ext.user_default.oneframe.pipeline.case.case_file import read_case
from bl_ext.user_default.oneframe.ui.keymap import PIN_TOOL, active_tool
from bl_ext.user_default.oneframe.view.zoom import free_rectangle
from user import PACKAGE


def scenario(user):
    shading = user.area.spaces.active.shading
    shading.color_type, shading.light = "RANDOM", "MATCAP"
    before, known = users_state(user), set(workspaces())
    bpy.ops.ed.undo_push(message="the user's file")
    bpy.ops.wm.save_as_mainfile(filepath=str(user.folder / "users.blend"), copy=True)

    # a new file, frame, typed K, surface: the default cube hides nothing
    user.call("load_frame", "EXEC_DEFAULT", True, filepath=str(user.case.parent / "frame.png"))
    yield from user.at_workbench()
    true = read_case(user.case).camera
    typed = bpy.context.scene.oneframe.camera
    typed.fx = typed.fy = repr(true.fx)
    user.call("set_camera", "EXEC_DEFAULT", True)
    yield 0.5
    yield from user.redraw()
    assert_frame_is_free(user)
    user.call("load_surface", "EXEC_DEFAULT", True, filepath=str(user.case.parent / "surface.ply"))
    yield from user.redraw()
    yield from user.open_case()
    assert len(bpy.data.scenes) == 2
    assert_frame_is_free(user)
    with user.context():
        assert active_tool(bpy.context) == PIN_TOOL

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


def assert_frame_is_free(user):
    """The whole frame lies beside toolbar, sidebar and headers, and fills what they leave."""
    view = user.frame_view
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
