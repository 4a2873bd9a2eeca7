"""The film's frames in the add-on: found as by the command, looked at without a trace, and as colour sources."""

import json

import bpy
import cv2
import numpy as np
import pytest

from blender_addon.colour.operators import is_outdated
from blender_addon.frames import found
from blender_addon.setup.open_case import unsaved_parts
from blender_addon.state import another_frame, from_scene
from blender_addon.video import session, shown_frame
from oneframe.alignment.reprojection import apply_twist
from oneframe.blender.case.load_case import load_case
from oneframe.blender.colour.surface_colour import colour_record
from oneframe.blender.registration.correct_source import correct_source
from oneframe.case.case_file import read_case
from oneframe.registration.verdict import ACCEPTED, REFUSED
from tests.alignment.test_refinement import hills
from tests.registration.test_registration import CAMERA, PIVOT, SOURCE, photograph, seen_from, write_case

ROUGH = apply_twist(np.array([0.5, -0.5, 3.0, *np.radians([0.6, -0.8, 0.4])]), SOURCE, PIVOT)
MIRRORED = 4
"""Number of the frame that shows another surface."""


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    made, mesh = tmp_path_factory.mktemp("case"), hills(1)
    write_case(made, mesh, ROUGH)
    (made / "case.toml").rename(made / "rough.toml")
    write_case(made, mesh, SOURCE)
    images = [photograph(mesh, seen_from(*pose)) for pose in ((8, 5), (-20, 30), (15, 90), (25, 0), (0, 0))]
    images[MIRRORED] = images[MIRRORED][:, ::-1]
    writer = cv2.VideoWriter(str(made / "film.avi"), cv2.VideoWriter_fourcc(*"MJPG"), 25.0, CAMERA.size_wh)
    for image in images:
        writer.write(np.ascontiguousarray(np.rint(255 * image).astype(np.uint8)))
    writer.release()
    return made


@pytest.fixture
def opened(addon, folder, tmp_path):
    def opened(name):
        case = tmp_path / name
        case.write_text((folder / name).read_text().replace('= "frame.png"', f'= "{folder}/frame.png"'))
        case.write_text(case.read_text().replace('= "surface.ply"', f'= "{folder}/surface.ply"'))
        bpy.ops.oneframe.open_case(filepath=str(case))
        bpy.ops.oneframe.open_video(filepath=str(folder / "film.avi"))
        return bpy.context.scene

    return opened


def state_of(scene, path):
    """All that looking might change: the saved case, the scene's own properties, and the picture behind the camera."""
    bpy.ops.oneframe.save_case(filepath=str(path))
    objects = [(each.name, np.array(each.matrix_world).tobytes(), str(dict(each.items()))) for each in scene.objects]
    shown = scene.oneframe.camera_object.data.background_images[0].image.name
    return path.read_bytes(), objects, str(scene.oneframe.items()), shown, scene.oneframe_view.opacity


def test_the_frames_are_those_of_the_command_and_looking_at_them_leaves_no_trace(
    opened, folder, tmp_path, run_oneframe
):
    scene = opened("case.toml")
    bpy.ops.oneframe.case_frame()
    bpy.ops.oneframe.landmark_set(point=(1, 2, 3), pixel=(100, 100))
    before = state_of(scene, tmp_path / "kept.toml")
    assert not bpy.ops.oneframe.play_frames.poll()
    bpy.ops.oneframe.register_frames()
    command = run_oneframe("register", folder / "case.toml", folder / "film.avi", "--out", tmp_path / "out")
    assert command.returncode == 0, command.stderr
    listed = json.loads((tmp_path / "out" / "poses.json").read_text())
    assert [entry["state"] for entry in listed] == [ACCEPTED] * MIRRORED + [REFUSED]
    frames, mesh_from_model = found.of(scene).frames, from_scene.mesh_from_model_of(scene.oneframe.surface)
    for at, entry in enumerate(listed):
        verdict, pose, _ = frames[at]
        assert (verdict.state, round(verdict.probability, 4)) == (entry["state"], entry["probability"])
        shown_frame.show(scene, at)
        seen = another_frame.seen(scene)
        assert seen.cam_from_model is pose
        if at == MIRRORED:
            assert (pose, seen.text) == (None, "lost")
            continue
        assert np.allclose(pose, entry["cam_from_mesh"] @ mesh_from_model, rtol=0, atol=1e-9)
        # what is done in the view would go to the case's own frame
        for refused in (bpy.ops.oneframe.nudge, lambda: bpy.ops.oneframe.landmark_set(point=(0, 0, 0))):
            with pytest.raises(RuntimeError, match=r"found frame \d of film.avi; press Esc"):
                refused()
    bpy.ops.oneframe.case_frame()
    assert another_frame.seen(scene) is None
    assert state_of(scene, tmp_path / "kept.toml") == before
    # what was found holds for the pose that it began with, and again once that is back
    bpy.ops.oneframe.nudge(step_px=1.0)
    assert found.of(scene) is None
    assert not bpy.ops.oneframe.use_colour_sources.poll()


def test_the_first_pose_is_corrected_as_by_the_command_and_undone(opened, folder, tmp_path, monkeypatch):
    monkeypatch.setattr("oneframe.blender.registration.correct_source.MOST_ROUNDS", 2)
    scene = opened("rough.toml")
    rough = from_scene.cam_from_model(scene)
    bpy.ops.ed.undo_push(message="before")
    bpy.ops.oneframe.correct_first_pose()
    bpy.ops.ed.undo_push(message="corrected")
    bpy.ops.ed.undo()
    assert np.array_equal(from_scene.cam_from_model(bpy.context.scene), rough)
    bpy.ops.ed.redo()
    bpy.ops.oneframe.save_case(filepath=str(tmp_path / "corrected.toml"))
    loaded = load_case(read_case(folder / "rough.toml"))
    other = correct_source(loaded, folder / "film.avi", tool="", date="", progress=lambda _: None).loaded.case
    ours = read_case(tmp_path / "corrected.toml")
    assert np.array_equal(ours.cam_from_mesh, other.cam_from_mesh)
    assert {**ours.alignment, "tool": "", "date": ""} == {**other.alignment, "start_method": "manual"}


def test_found_frames_colour_the_surface_once_the_case_is_saved(opened, tmp_path):
    scene = opened("case.toml")
    bpy.ops.oneframe.project_colour()
    bpy.ops.oneframe.register_frames()
    bpy.ops.oneframe.use_colour_sources(count=2)
    used = from_scene.further_frames(scene)
    assert len(used) == 2
    assert unsaved_parts(scene) == ("colour sources",)
    assert is_outdated(scene, colour_record(scene.oneframe.surface))
    bpy.ops.oneframe.save_case(filepath=str(tmp_path / "case.toml"))
    accepted = [frame.cam_from_model for frame in found.of(scene).frames.values() if frame.candidate is not None]
    mesh_from_model = from_scene.mesh_from_model_of(scene.oneframe.surface)
    for each in read_case(tmp_path / "case.toml").frames:
        assert cv2.imread(str(each.image), cv2.IMREAD_UNCHANGED).shape == (*CAMERA.shape_hw, 4)
        assert min(np.abs(each.cam_from_mesh @ mesh_from_model - pose).max() for pose in accepted) < 1e-9
    # the same again replaces them
    bpy.ops.oneframe.use_colour_sources(count=2)
    assert [each.image for each in from_scene.further_frames(scene)] == [each.image for each in used]
    bpy.ops.oneframe.project_colour()
    assert not is_outdated(scene, colour_record(scene.oneframe.surface))
    bpy.ops.oneframe.clear_colour_sources()
    assert from_scene.further_frames(scene) == ()


def test_without_a_film_or_an_aligned_frame_nothing_begins(addon, opened, folder):
    assert not bpy.ops.oneframe.register_frames.poll()
    scene = opened("case.toml")
    assert bpy.ops.oneframe.register_frames.poll()
    session._forget()
    assert not bpy.ops.oneframe.register_frames.poll()
    bpy.ops.oneframe.score_video()
    # a frame that shows no texture
    (blank := folder / "blank.png").write_bytes(cv2.imencode(".png", np.full((240, 320, 3), 90, np.uint8))[1])
    scene.oneframe.frame_path = str(blank)
    with pytest.raises(RuntimeError, match="expected texture on the surface"):
        bpy.ops.oneframe.register_frames()
