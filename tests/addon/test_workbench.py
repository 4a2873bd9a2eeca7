"""The workbench has a scene of its own: the user's scenes, views and world stay bit for bit as they are."""

import bpy
import pytest


@pytest.fixture
def users_scene(addon):
    """A scene as in a new file, with the user's own settings."""
    scene = bpy.context.scene
    scene.name = "mine"
    bpy.ops.mesh.primitive_cube_add()
    bpy.ops.object.camera_add(location=(3, 4, 5))
    scene.camera = bpy.context.object
    scene.world = bpy.data.worlds.new("mine")
    scene.render.resolution_x, scene.render.resolution_y, scene.unit_settings.scale_length = 1234, 567, 10.0
    for area in bpy.context.screen.areas:
        if area.type == "VIEW_3D":
            area.spaces.active.shading.color_type = "RANDOM"
    return scene


def state(scene):
    """Every plain setting of a scene with its render, unit and colour settings; its objects; its camera and world."""
    plain = {}
    for owner in (scene, scene.render, scene.unit_settings, scene.view_settings, scene.display):
        for declared in owner.bl_rna.properties:
            if declared.type in ("INT", "FLOAT", "BOOLEAN", "ENUM", "STRING") and declared.identifier != "use_nodes":
                value = getattr(owner, declared.identifier)
                plain[type(owner).__name__, declared.identifier] = list(value) if hasattr(value, "__len__") else value
    objects = {found.name: [list(row) for row in found.matrix_world] for found in scene.objects}
    return plain, objects, scene.camera, scene.world, [child.name for child in scene.collection.children]


def load_all(folder):
    bpy.ops.oneframe.load_frame(filepath=str(folder / "frame.png"))
    typed = bpy.context.scene.oneframe.camera
    typed.fx = typed.fy = "320"
    bpy.ops.oneframe.set_camera()
    bpy.ops.oneframe.load_surface(filepath=str(folder / "surface.ply"))


def test_the_users_scene_stays_as_it_is(users_scene, folder):
    before = state(users_scene)
    load_all(folder)
    bpy.ops.oneframe.nudge(axis="x", step_px=5.0)
    bpy.ops.oneframe.project_colour(mode="vertex")
    bench = bpy.context.scene
    assert bench != users_scene
    assert state(users_scene) == before
    # nothing of the user's stands before the frame
    assert set(bench.objects) == {bench.oneframe.camera_object, bench.oneframe.surface}
    assert bench.world is None


def test_the_workbench_is_found_again(users_scene, folder, tmp_path):
    """From the user's scene, and after saving and opening the file: there is one, and typed values come along."""
    bpy.context.scene.oneframe.camera.fx = "321"
    bpy.ops.oneframe.load_frame(filepath=str(folder / "frame.png"))
    bench = bpy.context.scene
    assert bench.oneframe.camera.fx == "321"
    bpy.context.window.scene = users_scene
    bpy.ops.oneframe.load_surface(filepath=str(folder / "surface.ply"))
    assert bpy.context.scene == bench
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "work.blend"))
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "work.blend"))
    bpy.ops.oneframe.open_case(filepath=str(folder / "case.toml"))
    assert len(bpy.data.scenes) == 2
    assert bpy.context.scene.oneframe.frame_path == str(folder / "frame.png")


def test_a_new_surface_shows_its_shape(in_view, folder):
    """Also after another one was shown in flat colours."""
    case = str(folder / "case.toml")
    bpy.ops.oneframe.open_case(filepath=case)
    for again in (
        lambda: bpy.ops.oneframe.open_case(filepath=case),
        lambda: bpy.ops.oneframe.load_surface(filepath=str(folder / "surface.ply")),
    ):
        bpy.ops.oneframe.project_colour(mode="vertex")
        shading = in_view.shading
        assert (shading.light, shading.color_type, shading.show_cavity) == ("FLAT", "VERTEX", False)
        again()
        assert (shading.light, shading.color_type, shading.show_cavity) == ("STUDIO", "OBJECT", True)


def test_the_first_orbit_turns_about_the_surface(in_view, folder):
    bpy.ops.oneframe.open_case(filepath=str(folder / "case.toml"))
    view = in_view.region_3d
    # Blender leaves the camera for the point at the depth of the view's location
    depth = -(bpy.context.scene.oneframe.camera_object.matrix_world.inverted() @ view.view_location).z
    assert depth == pytest.approx(300, rel=0.05)
    assert view.view_distance == pytest.approx(depth, rel=0.01)
    assert in_view.clip_start < 30
    assert in_view.clip_end > 600
