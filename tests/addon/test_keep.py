"""Nothing of a pose is lost: undo of a step through a queue, and what is not saved when Blender ends."""

import bpy
import numpy as np
import pytest

from blender_addon.setup import autosave
from blender_addon.setup.save_case import replaced_pose
from blender_addon.state import from_scene, pose_evidence
from oneframe.case.case_file import read_case
from oneframe.case.case_history import earlier_poses, history_path
from oneframe.case.pose_record import PoseRecord
from tests.addon.test_case_queue import move, pose, queue  # noqa: F401


@pytest.fixture
def session(addon, queue):  # noqa: F811
    """A queue with its first frame checked, and the undo steps of a user."""

    def step(name, **settings):
        getattr(bpy.ops.oneframe, name)(**settings)
        bpy.ops.ed.undo_push(message=name)

    bpy.ops.ed.undo_push(message="opened")
    step("queue_check")
    step("queue_step", step=-1)
    return queue, step


def test_undo_of_a_step_brings_the_frames_files_back(session):
    folder, step = session
    path = folder / "frame" / "case.toml"
    checked, checked_pose = path.read_bytes(), pose()
    move([1.0, 0.0, 0.0])
    bpy.ops.ed.undo_push(message="a stray key")
    step("queue_step")
    moved = path.read_bytes()
    assert moved != checked
    (earlier,) = earlier_poses(path)
    assert earlier.alignment.checked
    bpy.ops.ed.undo()
    assert (path.read_bytes(), history_path(path).exists()) == (checked, False)
    bpy.ops.ed.redo()
    assert path.read_bytes() == moved
    assert len(earlier_poses(path)) == 1
    bpy.ops.ed.undo()
    bpy.ops.ed.undo()
    assert path.read_bytes() == checked
    assert np.array_equal(pose(), checked_pose)
    # scene and file agree: nothing is saved over
    step("queue_step")
    assert path.read_bytes() == checked
    # a check as well
    bpy.ops.ed.undo()
    bpy.ops.ed.undo()
    bpy.ops.ed.undo()
    bpy.ops.ed.undo()
    assert not read_case(path).alignment.checked
    # what another program wrote meanwhile stays
    path.write_text(path.read_text() + "# mine\n")
    bpy.ops.ed.redo()
    assert "# mine" in path.read_text()


def test_hands_replace_a_checked_pose_after_a_question_only(session):
    scene, path = bpy.context.scene, session[0] / "frame" / "case.toml"
    assert replaced_pose(scene, path) == ""
    move([1.0, 0.0, 0.0])
    assert "was checked" in replaced_pose(scene, path)
    pose_evidence.remember(scene, PoseRecord("refined"), pose())
    assert replaced_pose(scene, path) == ""


def test_what_is_not_saved_is_kept_aside_and_restored(session):
    path = session[0] / "frame" / "case.toml"
    kept = autosave.aside(path)
    autosave.flush()
    assert not kept.exists()
    move([1.0, 0.0, 0.0])
    bpy.ops.oneframe.landmark_set(name="here", pixel=(10, 10))
    moved = pose()
    autosave.flush()
    assert kept.exists()
    text = path.read_bytes()
    # as after a kill: another session opens the case
    autosave._written.clear()
    bpy.ops.oneframe.open_case(filepath=str(path))
    assert not np.array_equal(pose(), moved)
    autosave.flush()
    assert kept.exists()
    assert bpy.ops.oneframe.restore_unsaved(filepath=str(kept)) == {"FINISHED"}
    assert np.allclose(pose(), moved, atol=1e-12)
    assert [entry.name for entry in bpy.context.scene.oneframe.landmarks] == ["here"]
    assert (path.read_bytes(), bpy.context.scene.oneframe.case_path) == (text, str(path))
    bpy.ops.oneframe.save_case(filepath=str(path))
    assert not kept.exists()
    assert np.allclose(read_case(path).cam_from_mesh[0, 3], from_scene.cam_from_mesh(bpy.context.scene)[0, 3])


def test_a_pose_is_kept_as_it_is_before_blender_draws_the_scene(addon, write_tiny_case, tmp_path):
    """Right after undo and redo, and in a file that shows another scene."""
    path, seen = write_tiny_case(tmp_path / "case"), []
    bpy.ops.oneframe.open_case(filepath=str(path))
    poses = []
    for _ in range(2):
        move([1.0, 0.0, 0.0])
        bpy.context.view_layer.update()
        poses.append(from_scene.cam_from_mesh(bpy.context.scene))
        bpy.ops.ed.undo_push(message="moved")

    def look(*_):
        autosave.flush()
        seen.append(read_case(autosave.aside(path)).cam_from_mesh)

    for handlers, step in (
        (bpy.app.handlers.undo_post, bpy.ops.ed.undo),
        (bpy.app.handlers.redo_post, bpy.ops.ed.redo),
    ):
        handlers.append(look)
        step()
        handlers.remove(look)
    window = bpy.context.window_manager.windows[0]
    window.scene = next(scene for scene in bpy.data.scenes if scene != window.scene)
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "work.blend"))
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "work.blend"))
    look()
    assert np.allclose(seen, [poses[0], poses[1], poses[1]], rtol=0, atol=1e-9)


def test_an_unanswered_pose_goes_into_the_history_and_a_discarded_one_ends(session):
    path = session[0] / "frame" / "case.toml"
    kept = autosave.aside(path)
    move([1.0, 0.0, 0.0])
    autosave.flush()
    autosave._written.clear()
    left = read_case(kept).cam_from_mesh
    bpy.ops.oneframe.open_case(filepath=str(path))
    move([0.0, 1.0, 0.0])
    autosave.flush()
    assert np.array_equal(earlier_poses(path)[0].cam_from_mesh, left)
    bpy.ops.oneframe.open_case(filepath=str(path), discard=True)
    assert not kept.exists()


def test_a_case_that_was_never_saved_comes_back_without_a_file(addon, write_tiny_case, tmp_path):
    case = write_tiny_case(tmp_path / "case")
    bpy.ops.oneframe.load_frame(filepath=str(case.with_name("frame.png")))
    bpy.ops.oneframe.load_camera(filepath=str(case))
    bpy.ops.oneframe.load_surface(filepath=str(case.with_name("surface.ply")))
    autosave.flush()
    assert autosave.left_behind() is None
    assert not autosave._written
    bpy.ops.oneframe.nudge(axis="x")
    moved = pose()
    autosave.flush()
    (kept,) = autosave._written
    autosave._written.clear()
    bpy.ops.oneframe.open_case(filepath=str(case))
    assert autosave.left_behind() == kept
    bpy.ops.oneframe.restore_unsaved(filepath=str(kept))
    assert np.allclose(pose(), moved, atol=1e-12)
    assert not bpy.context.scene.oneframe.case_path
    bpy.ops.oneframe.save_case(filepath=str(tmp_path / "mine.toml"))
    assert autosave.left_behind() is None


def test_a_case_that_states_part_of_an_uncertainty_opens(addon, write_tiny_case, tmp_path):
    """Somebody has taken lines out of its record."""
    path = write_tiny_case(tmp_path)
    text = path.read_text()
    assert "[alignment]" not in text
    path.write_text(f"{text}\n[alignment]\nmethod = 'registered'\ncovariance_mm_rad = {np.eye(6).tolist()}\n")
    assert bpy.ops.oneframe.open_case(filepath=str(path)) == {"FINISHED"}
