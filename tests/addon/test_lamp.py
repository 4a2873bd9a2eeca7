"""The lamp at the lens in the window: found, undone, kept, and previewed as the command renders it."""

from dataclasses import replace

import bpy
import numpy as np
import pytest

from blender_addon.colour.lamp import keep_lamp
from blender_addon.dataset import view_preview as dataset
from blender_addon.frames import film_poses
from blender_addon.setup import history
from blender_addon.setup.case_in_scene import unsaved_parts
from blender_addon.state.case_of_file import lamp_of
from blender_addon.video import session
from oneframe.alignment.pose_uncertainty import PoseUncertainty
from oneframe.case.case_file import read_case
from oneframe.case.case_history import earlier_cases
from oneframe.commands.__main__ import dispatch
from oneframe.images.pixel_values import codes_from_linear, linear_from_codes
from oneframe.images.png import encode_png
from oneframe.light.lens_light import LensLight, shading, working_distance_mm
from oneframe.projection.overlay_scene import smooth_normals
from oneframe.projection.visible_surface import central_point
from oneframe.projection.z_buffer import rasterise_depth
from oneframe.registration.register import RegisteredFrame
from oneframe.registration.verdict import ACCEPTED, Verdict
from oneframe.transforms import inverse_rigid, transform_points
from tests.addon.test_dataset import case_path, refused, script_job  # noqa: F401
from tests.alignment.test_refinement import hills
from tests.registration.test_registration import CAMERA, SOURCE, photograph, seen_from, write_case
from tests.video.surgical_film import write_film

pytestmark = pytest.mark.render

POSES = [seen_from(-20, 30), seen_from(15, 90)]
LAMP = LensLight((-13.04, 16.0, 2.0), 0.07)


def test_a_lamp_is_undone_saved_and_in_the_history(opened, case_path):  # noqa: F811
    scene = opened
    assert lamp_of(scene) is None
    bpy.ops.ed.undo_push(message="before")
    keep_lamp(scene, LAMP)
    bpy.ops.ed.undo_push(message="lamp")
    assert unsaved_parts(scene) == ("lamp",)
    history.flush()
    assert earlier_cases(case_path)[0].case.light == LAMP
    bpy.ops.ed.undo()
    assert lamp_of(bpy.context.scene) is None
    bpy.ops.ed.redo()
    bpy.ops.oneframe.save_case(filepath=str(case_path))
    scene = bpy.context.scene
    assert read_case(case_path).light == lamp_of(scene) == LAMP
    assert unsaved_parts(scene) == ()


@pytest.mark.parametrize("light", ["lens", "shadows"])
def test_the_previewed_view_in_its_light_is_that_of_the_run(opened, case_path, tmp_path, light):  # noqa: F811
    opened.oneframe.dataset.light = light
    refused(bpy.ops.oneframe.preview_view, "expected the lamp at the lens")
    keep_lamp(opened, LAMP)
    bpy.ops.oneframe.preview_view()
    image, _, outdated = dataset.preview(opened)
    assert not outdated
    bpy.ops.oneframe.save_case(filepath=str(case_path))
    with script_job(case_path, tmp_path).renderer(threads=1) as renderer:
        expected = renderer.make(0).rendered.rgb
    found = np.empty(expected.shape[0] * expected.shape[1] * 4, np.float32)
    image.pixels.foreach_get(found)
    assert np.abs(found.reshape(*expected.shape[:2], 4)[::-1, :, :3] - expected).max() <= 0.5001 / 255
    keep_lamp(opened, replace(LAMP, ambient=0.2))
    assert dataset.preview(opened)[2]
    keep_lamp(opened, LAMP)
    # before and after
    opened.oneframe.dataset.light = "none"
    assert dataset.preview(opened) is None
    bpy.ops.oneframe.preview_view()
    before = dataset.preview(opened)[0]
    opened.oneframe.dataset.light = light
    assert dataset.preview(opened)[0] == image != before
    assert not dataset.preview(opened)[2]
    keep_lamp(opened, None)
    assert dataset.preview(opened)[2]
    opened.oneframe.dataset.light = "none"
    assert not dataset.preview(opened)[2]


def lit(mesh, pose):
    """Codes (H, W, 3), uint8: a painted surface in the light of the lens."""
    raster = rasterise_depth(mesh, CAMERA, pose)
    shown, (v, u) = raster.face >= 0, np.nonzero(raster.face >= 0)
    rays = CAMERA.rays_cam(np.stack([u, v], axis=1).astype(float))
    points = transform_points(inverse_rigid(pose), rays / raster.inverse_depth[shown][:, None])
    normals = smooth_normals(mesh, mesh.smooth_normals, raster.face[shown], points)
    light = LensLight((*LAMP.lamp_cam_mm[:2], 0.0), LAMP.ambient)
    factors = shading(
        light, points, normals, pose, working_distance_mm(pose, central_point(raster.depth_mm, CAMERA, pose))
    )
    image = photograph(mesh, pose)
    image[shown] = codes_from_linear(linear_from_codes(image[shown]) * factors[:, None])
    return np.rint(255 * np.clip(image, 0, 1)).astype(np.uint8)


def filmed(folder, images):
    """A case and its film, opened, with the film's frames found where they are."""
    write_case(folder, hills(1), SOURCE)
    (folder / "frame.png").write_bytes(encode_png(images[0]))
    write_film(folder / "film.avi", [image[..., ::-1] for image in images[1:]], "MJPG")
    bpy.ops.oneframe.open_case(filepath=str(folder / "case.toml"))
    bpy.ops.oneframe.open_video(filepath=str(folder / "film.avi"))
    bpy.ops.oneframe.case_frame()
    registered = film_poses.begun(bpy.context.scene, session.scored(bpy.context.scene))
    points = hills(1).vertices
    for number, pose in enumerate(POSES):
        uncertainty = PoseUncertainty.about_points(np.zeros(3), 1e-4 * np.eye(6), points, pose)
        registered.frames[number] = RegisteredFrame(Verdict(ACCEPTED, 1.0, ""), pose, uncertainty)
    registered.write()
    return bpy.context.scene, registered.file


def test_the_lamp_is_found_by_the_films_frames_as_the_command_finds_it(addon, tmp_path):
    case = tmp_path / "case.toml"
    scene, poses = filmed(tmp_path, [lit(hills(1), pose) for pose in (SOURCE, *POSES)])
    assert bpy.ops.oneframe.find_lamp() == {"FINISHED"}
    light = lamp_of(scene)
    assert np.abs(np.subtract(light.lamp_cam_mm, (-13.04, 16.0, 0.0))).max() < 3
    assert light.origin["frames"] == 3
    bpy.ops.oneframe.save_case(filepath=str(case))
    assert read_case(case).light == light
    dispatch(["light", *map(str, (case, poses, "--video", tmp_path / "film.avi"))])
    assert read_case(case).light.law == light.law


def test_where_the_frame_tells_no_lamp_the_figures_say_so(opened):
    refused(bpy.ops.oneframe.find_lamp, r"one frame does not tell .* explains \d+% .*; open its film and press")
    assert lamp_of(opened) is None
