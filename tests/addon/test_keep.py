"""Nothing of a pose is lost: all that is settled is in the history."""

import bpy
import numpy as np
import pytest

from blender_addon.refine.status_line import status
from blender_addon.setup import history
from blender_addon.setup.case_in_scene import unsaved_parts
from blender_addon.state import from_scene
from blender_addon.state.scene_files import forget_stamps
from oneframe.case.case_file import read_case
from oneframe.case.case_history import earlier_cases, history_path
from tests.addon.conftest import refused
from tests.addon.test_case_queue import move, pose


@pytest.fixture
def case(opened, case_path):
    return case_path


def scene():
    return bpy.context.scene


def places(path):
    """x of the poses in a history, the latest first."""
    return [round(each.case.cam_from_mesh[0, 3], 6) for each in earlier_cases(path)]


def forget_session():
    """As if Blender had been killed: the next one knows nothing."""
    for known in (history._kept, history._moving, history._read):
        known.clear()


def test_a_settled_pose_is_in_the_history_and_comes_back_whatever_ends_blender(case):
    text, first = case.read_bytes(), from_scene.cam_from_mesh(scene())[0, 3]
    for _ in range(3):
        history._tick()
    assert not history_path(case).exists(), "what is only looked at has none"
    move([1.0, 0.0, 0.0])
    history._tick()
    move([1.0, 0.0, 0.0])
    history._tick()
    assert not history_path(case).exists(), "still moving"
    bpy.ops.oneframe.landmark_set(name="here", pixel=(10, 10))
    moved = pose()
    for _ in range(3):
        history._tick()
    assert places(case) == [round(first + 2, 6)]
    # killed; another session opens the case, and says so
    forget_session()
    bpy.ops.oneframe.open_case(filepath=str(case))
    assert "not in the file" in history.later_text(scene())
    assert bpy.ops.oneframe.restore(number=0) == {"FINISHED"}
    assert np.allclose(pose(), moved, atol=1e-12)
    assert [entry.name for entry in scene().oneframe.landmarks] == ["here"]
    assert (case.read_bytes(), scene().oneframe.case_path) == (text, str(case))
    assert unsaved_parts(scene()) == ("pose", "landmarks")
    history.flush()
    assert len(places(case)) == 1, "nothing twice"
    # opening a case, this one or another, keeps what has not been saved; so does another .blend file
    move([0.5, 0.0, 0.0])
    bpy.ops.oneframe.open_case(filepath=str(case))
    assert places(case)[0] == round(first + 2.5, 6)
    move([0.25, 0.0, 0.0])
    bpy.ops.wm.read_homefile(use_empty=True)
    assert places(case)[0] == round(first + 0.25, 6)


def test_undo_and_redo_leave_no_stale_entry(case):
    first = from_scene.cam_from_mesh(scene())[0, 3]
    bpy.ops.ed.undo_push(message="opened")
    for _ in range(2):
        bpy.ops.oneframe.nudge(axis="x")
        bpy.ops.ed.undo_push(message="nudged")
        history.flush()
    kept = places(case)
    assert len(kept) == 2
    for step in (bpy.ops.ed.undo, bpy.ops.ed.undo, bpy.ops.ed.redo):
        step()
        history.flush()
    assert [place for place in places(case) if place not in kept] in ([], [round(first, 6)])
    assert len(places(case)) == len(set(places(case)))


def test_a_case_that_was_never_saved_has_its_history_beside_the_frame(addon, write_tiny_case, tmp_path):
    path = write_tiny_case(tmp_path / "case")
    bpy.ops.oneframe.load_frame(filepath=str(path.with_name("frame.png")))
    bpy.ops.oneframe.load_camera(filepath=str(path))
    bpy.ops.oneframe.load_surface(filepath=str(path.with_name("surface.ply")))
    beside = path.with_name("frame.toml")
    history.flush()
    assert not history_path(beside).exists(), "nobody has aligned it"
    bpy.ops.oneframe.nudge(axis="x")
    moved = pose()
    history.flush()
    bpy.ops.oneframe.nudge(axis="y")
    assert bpy.ops.oneframe.restore(number=0) == {"FINISHED"}
    assert np.allclose(pose(), moved, atol=1e-12)
    assert not scene().oneframe.case_path
    (tmp_path / "mine").mkdir()
    bpy.ops.oneframe.save_case(filepath=str(tmp_path / "mine/mine.toml"))
    assert not history_path(beside).exists()
    assert len(earlier_cases(tmp_path / "mine/mine.toml")) == 2


def test_two_windows_on_one_case_lose_nothing_of_each_other(case):
    move([1.0, 0.0, 0.0])
    other = case.read_text().replace('units = "mm"', 'units = "mm"\n# by the other window')
    case.write_text(other)
    forget_stamps()
    assert history.is_changed_elsewhere(scene())
    assert bpy.ops.oneframe.save_case(filepath=str(case)) == {"FINISHED"}
    assert case.read_text() == other
    assert len(places(case)) == 1
    bpy.ops.oneframe.open_case(filepath=str(case))
    assert not history.is_changed_elsewhere(scene())
    bpy.ops.oneframe.restore(number=0)
    bpy.ops.oneframe.save_case(filepath=str(case))
    assert from_scene.cam_from_mesh(scene())[0, 3] == pytest.approx(read_case(case).cam_from_mesh[0, 3], abs=1e-9)


def test_a_damaged_history_stops_no_work(case, capfd):
    history_path(case).write_text('[{"cam_from_mesh": 1}]\n')
    forget_stamps()
    refused(bpy.ops.oneframe.restore, r"line 1: expected an earlier case", number=0)
    move([1.0, 0.0, 0.0])
    history.flush()
    bpy.ops.oneframe.save_case(filepath=str(case))
    assert "saved" in status(scene())[0]
    assert capfd.readouterr().err == ""
