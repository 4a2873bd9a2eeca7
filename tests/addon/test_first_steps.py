"""The first minutes: dropped files, the sample, what comes next; and the user's scenes, which stay as they are."""

import re

import bpy
import numpy as np
import pytest

from blender_addon.frames.film_poses import film_of_case
from blender_addon.setup import open_case as sample
from blender_addon.setup.alignment_record import pose_record
from blender_addon.setup.case_in_scene import unsaved_parts
from blender_addon.state import from_scene, to_scene
from blender_addon.state.scene_files import forget_stamps, recent
from oneframe.case.case_file import read_case
from oneframe.case.pose_record import PoseRecord
from oneframe.transforms import transform_points
from tests.addon.conftest import refused
from tests.video.surgical_film import write_film


def test_a_case_without_a_pose_opens_at_a_guess_and_is_saved_with_a_pose(addon, folder):
    path = folder / "case.toml"
    text = path.read_text().replace("[pose]", "[dataset]\n[pose]")
    path.write_text(re.sub(r"\[pose\]\ncam_from_mesh = .*", "count = 7", text))
    bpy.ops.oneframe.open_case(filepath=str(path))
    scene = bpy.context.scene
    assert pose_record(scene) == PoseRecord("initial guess")
    assert unsaved_parts(scene) == ()
    bpy.ops.oneframe.nudge(axis="x", step_px=3)
    assert unsaved_parts(scene) == ("pose",)
    assert pose_record(scene).method == "manual"
    bpy.ops.oneframe.save_case(filepath=str(path))
    assert "count = 7" in path.read_text()
    assert read_case(path).alignment.method == "manual"
    assert unsaved_parts(scene) == ()


def test_the_users_scenes_keep_blenders_own_handling_of_images_and_meshes(in_view, folder):
    names = [name for name in dir(bpy.types) if name.startswith("ONEFRAME_FH_")]
    handlers = {name: getattr(bpy.types, name) for name in names}
    assert {name for name, kind in handlers.items() if kind.poll_drop(bpy.context)} == {
        "ONEFRAME_FH_case",
        "ONEFRAME_FH_ct",
    }
    case = handlers.pop("ONEFRAME_FH_case")
    # as a drop calls it
    room, _, name = case.bl_import_operator.partition(".")
    getattr(getattr(bpy.ops, room), name)("INVOKE_DEFAULT", filepath=str(folder / "case.toml"))
    assert bpy.context.scene.oneframe.surface is not None
    assert all(kind.poll_drop(bpy.context) for kind in handlers.values())
    kinds = {kind for handler in handlers.values() for kind in handler.bl_file_extensions.split(";")}
    assert ".toml" not in kinds
    assert {".png", ".ply", ".yaml", ".csv", ".nrrd"} <= kinds


def test_a_surface_that_is_loaded_first_is_in_view(addon, folder):
    bpy.ops.oneframe.load_surface(filepath=str(folder / "surface.ply"))
    surface = bpy.context.scene.oneframe.surface
    radius = max(vertex.co.length for vertex in surface.data.vertices)
    areas = [area for area in bpy.context.screen.areas if area.type == "VIEW_3D"]
    assert areas
    for area in areas:
        view, space = area.spaces.active.region_3d, area.spaces.active
        assert (view.view_location - surface.matrix_world.translation).length < 1e-3
        assert radius < view.view_distance < 5 * radius
        assert space.clip_start < view.view_distance - radius < view.view_distance + radius < space.clip_end


def test_the_sample_is_a_copy_that_the_user_may_change(addon, folder, tmp_path, monkeypatch):
    refused(bpy.ops.oneframe.open_sample, "oneframe sample")
    monkeypatch.setattr(sample, "SHIPPED", folder)
    copy = sample.copied_sample(tmp_path / "mine")
    (copy / "case.toml").write_text("changed")
    assert (sample.copied_sample(copy) / "case.toml").read_text() == "changed"
    assert (copy / "surface.ply").read_bytes() == (folder / "surface.ply").read_bytes()


def test_k_typed_before_the_frame_gets_the_frames_size(addon, folder):
    typed = bpy.context.scene.oneframe.camera
    typed.fx, typed.fy, typed.cx, typed.cy = "320", "320", "31.5", "23.5"
    bpy.ops.oneframe.set_camera()
    bpy.ops.oneframe.load_frame(filepath=str(folder / "frame.png"))
    bpy.ops.oneframe.set_camera()
    scene = bpy.context.scene
    assert from_scene.camera(scene).size_wh == tuple(scene.oneframe.frame_size)
    assert to_scene.frame_warnings(scene) == ()


def test_a_ghost_of_the_surface_shows_until_its_pose_is_found(addon, folder):
    """A given pose has none; a guess has one, through pins, until landmarks determine it or the user chooses."""
    bpy.ops.oneframe.open_case(filepath=str(folder / "case.toml"))
    scene = bpy.context.scene
    view, pose = scene.oneframe_view, from_scene.cam_from_model(scene)
    assert view.opacity == 0
    bpy.ops.oneframe.load_surface(filepath=str(folder / "surface.ply"))
    vertices = scene.oneframe.surface.data.vertices
    shown = []
    for number in (147, 306, 546, 705):
        point = np.array(vertices[number].co)
        pixel = from_scene.camera(scene).project(transform_points(pose, point[None]))[0]
        shown.append(round(view.opacity, 3))
        bpy.ops.oneframe.landmark_set(point=point, pixel=pixel)
    assert shown == [0.3] * 4
    assert view.opacity == 0
    bpy.ops.oneframe.landmarks_clear()
    assert round(view.opacity, 3) == 0.3
    view.opacity = 0.0
    assert view.opacity == 0, "what the user has set stays"


def test_recent_cases_and_their_films_are_found_again(addon, folder):
    write_film(folder / "film.avi", [np.full((48, 64, 3), level, np.uint8) for level in (90, 120)], "MJPG")
    path = folder / "case.toml"
    path.write_text(path.read_text().replace("[frame]", '[frame]\nvideo = "film.avi"\nvideo_frame = 1'))
    bpy.ops.oneframe.open_case(filepath=str(path))
    assert recent("cases")[0] == path
    assert film_of_case(bpy.context.scene) == folder / "film.avi"
    # moved elsewhere, and opened from there once
    (folder / "films").mkdir()
    (folder / "film.avi").rename(folder / "films/film.avi")
    forget_stamps()
    assert film_of_case(bpy.context.scene) is None
    bpy.ops.oneframe.open_video(filepath=str(folder / "films/film.avi"))
    assert film_of_case(bpy.context.scene) == folder / "films/film.avi"


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
