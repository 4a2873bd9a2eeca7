"""The dataset from the add-on: previews, the lamp and runs agree with the script; runs are followed and resumed."""

import os
from dataclasses import replace
from pathlib import Path

import bpy
import numpy as np
import pytest
from mathutils import Matrix

from blender_addon.colour.lamp import keep_lamp
from blender_addon.dataset import background_job
from blender_addon.dataset.view_preview import preview
from blender_addon.frames import film_poses
from blender_addon.setup import history
from blender_addon.setup.case_in_scene import unsaved_parts
from blender_addon.state import from_scene
from blender_addon.state.case_of_file import lamp_of
from blender_addon.state.scene_files import forget_stamps
from blender_addon.video import session
from oneframe.alignment.pose_uncertainty import PoseUncertainty
from oneframe.blender.dataset.job import Job, open_job
from oneframe.case.case_changes import differing_fields
from oneframe.case.case_file import Case, read_case
from oneframe.case.case_history import earlier_cases
from oneframe.case.case_writer import write_case
from oneframe.commands.__main__ import dispatch
from oneframe.dataset.options import checked_options
from oneframe.dataset.run.run_folder import Shard
from oneframe.images.png import encode_png
from oneframe.light.lens_light import LensLight
from oneframe.registration.register import RegisteredFrame
from oneframe.registration.verdict import ACCEPTED, Verdict
from oneframe.surface.mesh_writer import write_ply
from oneframe.transforms import rigid
from tests.addon.conftest import pixels_of, refused
from tests.blender.dataset.job_runs import finished_views
from tests.light import test_find_lamp as lit
from tests.tree import tree
from tests.video.surgical_film import write_film
from tests.waiting import wait_until

pytestmark = pytest.mark.render

LAMP = LensLight((-13.04, 16.0, 2.0), 0.07)
DATASET = "\n[dataset]\ncount = {count}\nscale = 0.5\nseed = 5\n"


@pytest.fixture
def case_path(write_tiny_case, tmp_path):
    path = write_tiny_case(tmp_path / "case")
    path.write_text("# aligned by eye\n" + path.read_text() + DATASET.format(count=6))
    return path


def script_job(case_path, out):
    case = read_case(case_path)
    options = checked_options(case.dataset, "test")
    return open_job(Job(case, out, options, Shard()))


def followed(until) -> object:
    """Call the timer, as Blender's event loop would, until the job meets a condition; returns the job."""
    wait_until(lambda: (background_job._follow(), until(background_job.current()))[1], otherwise=background_job.current)
    return background_job.current()


def ended(job) -> bool:
    return not job.running


def is_shown(image, expected) -> bool:
    """Whether a Blender image has the codes ``(H, W, 3)``, 0..1, to the last of 255."""
    return np.abs(pixels_of(image) / 255 - expected).max() <= 0.5001 / 255


def test_listed_poses_replace_the_sampler(addon, write_tiny_case, tmp_path):
    path = write_tiny_case(tmp_path / "case")
    pose = read_case(path).cam_from_mesh
    np.save(tmp_path / "case" / "poses.npy", np.stack([pose, rigid(translation=[1.0, 0, 5.0]) @ pose]))
    path.write_text(path.read_text() + '\n[dataset]\nposes = "poses.npy"\n')
    bpy.ops.oneframe.open_case(filepath=str(path))
    scene = bpy.context.scene
    scene.oneframe.preview_view = 1
    bpy.ops.oneframe.preview_view()
    assert not preview(scene)[2]
    os.utime(tmp_path / "case" / "poses.npy", ns=(0, 0))
    forget_stamps()
    assert preview(scene)[2]
    scene.oneframe.preview_view = 2
    refused(bpy.ops.oneframe.preview_view, "0 to 1")


def change_pose(scene):
    surface = scene.oneframe.surface
    surface.matrix_world = Matrix.Translation((0.3, 0, 0)) @ surface.matrix_world
    bpy.context.view_layer.update()


def touch_mesh(scene):
    path = Path(scene.oneframe.surface.oneframe.mesh_path)
    os.utime(path, ns=(0, 0))
    forget_stamps()


@pytest.mark.parametrize("light", ["none", "lens", "shadows"])
def test_previewed_view_is_that_of_the_run(opened, case_path, tmp_path, light):
    opened.oneframe.preview_view, opened.oneframe.dataset.light = 2, light
    scene, camera, frame = opened.name, opened.camera, opened.frame_current
    if light != "none":
        refused(bpy.ops.oneframe.preview_view, "expected the lamp at the lens")
        keep_lamp(opened, LAMP)
    bpy.ops.oneframe.preview_view()
    image, summary, outdated = preview(opened)
    assert not outdated
    assert summary.startswith("view 2: surface covers ")
    assert (bpy.context.scene.name, opened.camera, opened.frame_current) == (scene, camera, frame)
    bpy.ops.oneframe.save_case(filepath=str(case_path))
    with script_job(case_path, tmp_path).renderer(threads=1) as renderer:
        expected = renderer.make(2).rendered.rgb
    assert is_shown(image, expected)


def test_a_preview_is_outdated_by_what_changes_it_and_kept_for_each_light(opened):
    keep_lamp(opened, LAMP)
    opened.oneframe.dataset.light = "lens"
    bpy.ops.oneframe.preview_view()
    for change in (
        lambda scene: setattr(scene.oneframe, "preview_view", 3),
        change_pose,
        touch_mesh,
        lambda scene: setattr(scene.oneframe.dataset, "unseen", "fill"),
        lambda scene: keep_lamp(scene, replace(LAMP, ambient=0.2)),
    ):
        change(opened)
        assert preview(opened)[2]
        bpy.ops.oneframe.preview_view()
        assert not preview(opened)[2]
    image = preview(opened)[0]
    opened.oneframe.dataset.light = "none"
    assert preview(opened) is None
    bpy.ops.oneframe.preview_view()
    before = preview(opened)[0]
    opened.oneframe.dataset.light = "lens"
    assert preview(opened)[0] == image != before
    keep_lamp(opened, None)
    assert preview(opened)[2]
    opened.oneframe.dataset.light = "none"
    assert not preview(opened)[2]
    opened.oneframe.preview_view = 6
    refused(bpy.ops.oneframe.preview_view, "expected a view of the dataset, 0 to 5")


def test_a_run_makes_the_scripts_dataset_and_saves_its_settings_alone(opened, case_path, tmp_path, run_oneframe):
    """A snapshot beside the dataset holds what the window shows; it is the same bytes for the same case."""
    before, out = read_case(case_path), tmp_path / "elsewhere" / "out"
    opened.oneframe.dataset_out, opened.oneframe.dataset.count = str(out), 2
    bpy.ops.oneframe.nudge(axis="x")
    opened.oneframe.landmarks.add().name = "new"
    assert bpy.ops.oneframe.render_dataset() == {"FINISHED"}
    refused(bpy.ops.oneframe.render_dataset, "A run is in progress")
    job = followed(ended)
    assert (job.code, job.error, job.progress.count, job.progress.total) == (0, "", 2, 2)
    assert job.lines[-1] == f"dataset of 2 views: {out}"
    text, saved, snapshot = case_path.read_bytes(), read_case(case_path), out.with_name("out.case.toml")
    assert differing_fields(before, saved) == ("dataset",)
    assert saved.dataset["count"] == 2
    rendered, case = snapshot.read_bytes(), read_case(snapshot)
    assert np.array_equal(case.cam_from_mesh, from_scene.cam_from_mesh(opened))
    assert [path.resolve() for path in (case.image, case.mesh)] == [
        path.resolve() for path in (saved.image, saved.mesh)
    ]
    assert run_oneframe("render", snapshot, "--out", tmp_path / "script", "--workers", 1).returncode == 0
    assert tree(out) == tree(tmp_path / "script")
    background_job._jobs.clear()
    # what it cannot become is said before anything starts, and nothing is written
    files = tree(out)
    for change, message in ((other_seed, "Seed was 5, is 6"), (change_pose, "the pose has changed")):
        bpy.ops.oneframe.open_case(filepath=str(snapshot))
        opened.oneframe.dataset_out = str(out)
        change(opened)
        with pytest.raises(RuntimeError, match=message) as caught:
            bpy.ops.oneframe.render_dataset()
        assert "--" not in str(caught.value)
    assert background_job.current() is None
    assert (tree(out), snapshot.read_bytes(), case_path.read_bytes()) == (files, rendered, text)
    bpy.ops.oneframe.open_case(filepath=str(case_path))
    opened.oneframe.dataset_out = str(out.with_name("mine"))
    (out.with_name("mine")).mkdir()
    (out.with_name("mine") / "notes.txt").write_text("not a dataset")
    refused(bpy.ops.oneframe.render_dataset, "found other files; choose another folder")
    out.with_name("new.case.toml").write_text("# mine\n")
    opened.oneframe.dataset_out = str(out.with_name("new"))
    refused(bpy.ops.oneframe.render_dataset, "that of an earlier run")
    assert out.with_name("new.case.toml").read_text() == "# mine\n"


def test_a_cancelled_run_keeps_its_views_and_can_be_resumed(opened, case_path, tmp_path):
    """Cancel ends the run's input, as the end of a killed program does."""
    out = tmp_path / "out"
    opened.oneframe.dataset_out = str(out)
    opened.oneframe.dataset.count = 30
    bpy.ops.oneframe.render_dataset()
    process = background_job.current().process
    followed(lambda job: finished_views(out) >= 2)
    bpy.ops.oneframe.cancel_dataset()
    job = followed(ended)
    assert job.cancelled
    assert job.error == ""
    assert process.returncode == 130
    kept = {name: data for name, data in tree(out).items() if name.startswith("train_synt")}
    assert 2 <= finished_views(out) < 30
    # the user adds a landmark meanwhile, which does not change the views
    opened.oneframe.landmarks.add().name = "later"
    bpy.ops.oneframe.render_dataset()
    counts = []
    job = followed(lambda job: counts.append(job.progress and job.progress.count) or ended(job))
    assert (job.code, job.error) == (0, "")
    assert finished_views(out) == 30
    after = tree(out)
    assert all(after[name] == data for name, data in kept.items())
    counts = [count for count in counts if count is not None]
    assert counts[0] >= 2
    assert counts == sorted(counts)
    assert read_case(case_path).landmarks == ()


def test_disabling_the_addon_stops_the_run(opened, addon, tmp_path):
    opened.oneframe.dataset_out = str(tmp_path / "out")
    opened.oneframe.dataset.count = 1000
    bpy.ops.oneframe.render_dataset()
    process = background_job.current().process
    followed(lambda job: job.progress is not None)
    addon.unregister()
    try:
        # killed if the machine is too busy to end it in time
        assert process.returncode in (130, -9)
        assert not bpy.app.timers.is_registered(background_job._follow)
        assert background_job.current() is None
    finally:
        addon.register()


def test_the_message_of_a_failed_run_reaches_the_user(opened, case_path, tmp_path):
    opened.oneframe.dataset_out = str(tmp_path / "out")
    bpy.ops.oneframe.render_dataset()
    # while its process starts
    frame = case_path.with_name("frame.png")
    frame.write_bytes(frame.read_bytes()[:-200])
    job = followed(ended)
    assert "the file is cut off" in job.error
    assert "\n" not in job.error
    assert not job.cancelled


def other_seed(scene):
    scene.oneframe.dataset.seed = 6


def test_settings_that_a_run_would_refuse_are_refused_at_once(opened, case_path):
    options, text = opened.oneframe.dataset, case_path.read_bytes()
    options.distance_min, options.distance_max = 2.0, 1.0
    for operator in (bpy.ops.oneframe.render_dataset, bpy.ops.oneframe.preview_view):
        refused(operator, "expected Nearest .* <= Farthest")
    assert background_job.current() is None
    assert case_path.read_bytes() == text


def test_a_lamp_is_undone_saved_and_in_the_history(opened, case_path):
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


@pytest.fixture
def filmed(addon, tmp_path):
    """A case and its film, opened, with the film's frames found where they are; the file of their poses."""
    mesh, (source, *poses) = lit.hills(), lit.POSES
    case = Case(tmp_path / "case.toml", 1.0, tmp_path / "frame.png", lit.CAMERA, None, tmp_path / "surface.ply", source)
    write_ply(case.mesh, mesh)
    photographs = (lit.photograph(mesh, lit.lit_by(lit.LAMP), pose).image for pose in lit.POSES)
    own, *others = (np.rint(255 * image).astype(np.uint8) for image in photographs)
    case.image.write_bytes(encode_png(own))
    write_film(tmp_path / "film.avi", others, "MJPG")
    write_case(case.path, case)
    bpy.ops.oneframe.open_case(filepath=str(case.path))
    bpy.ops.oneframe.open_video(filepath=str(tmp_path / "film.avi"))
    bpy.ops.oneframe.case_frame()
    scene = bpy.context.scene
    registered = film_poses.begun(scene, session.scored(scene))
    mesh_from_model = from_scene.mesh_from_model_of(scene.oneframe.surface)
    for number, cam_from_mesh in enumerate(poses):
        pose = cam_from_mesh @ mesh_from_model
        uncertainty = PoseUncertainty.about_points(np.zeros(3), 1e-4 * np.eye(6), mesh.vertices, pose)
        registered.frames[number] = RegisteredFrame(Verdict(ACCEPTED, 1.0, ""), pose, uncertainty)
    registered.write()
    return registered.file


def test_the_lamp_is_found_by_the_films_frames_as_the_command_finds_it(filmed, tmp_path):
    case = tmp_path / "case.toml"
    assert bpy.ops.oneframe.find_lamp() == {"FINISHED"}
    light = lamp_of(bpy.context.scene)
    assert np.abs(np.subtract(light.lamp_cam_mm, lit.LAMP.lamp_cam_mm)).max() < 3
    assert light.origin["frames"] == len(lit.POSES)
    bpy.ops.oneframe.save_case(filepath=str(case))
    assert read_case(case).light == light
    dispatch(["light", *map(str, (case, filmed, "--video", tmp_path / "film.avi"))])
    assert read_case(case).light.law == light.law


def test_where_the_frame_tells_no_lamp_the_figures_say_so(opened):
    refused(bpy.ops.oneframe.find_lamp, r"one frame does not tell .* explains \d+% .*; open its film and press")
    assert lamp_of(opened) is None
