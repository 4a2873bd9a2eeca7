"""A queue in the window: every frame begins where the last one ended, is saved to its own case, and none is lost."""

import bpy
import numpy as np
import pytest

from blender_addon.refine.status_line import status
from blender_addon.setup import queued
from blender_addon.setup.alignment_record import pose_record
from blender_addon.state import from_scene, pose_evidence
from blender_addon.state.scene_files import forget_stamps, recent
from blender_addon.video import shown_frame
from oneframe.blender.alignment import surface_object
from oneframe.case.case_file import read_case
from oneframe.case.case_queue import CHECKED, NEW, REFUSED, ROUGH, queued_cases, state_of
from oneframe.case.pose_record import REGISTERED, PoseRecord
from oneframe.images.png import encode_png
from oneframe.transforms import rigid
from tests.addon.conftest import refused
from tests.tree import tree
from tests.video.surgical_film import write_film


@pytest.fixture
def queue(addon, write_tiny_case, tmp_path):
    """A case and two more frames in a queue; returns its folder."""
    case = write_tiny_case(tmp_path / "case")
    names = ["later.png", "last.png"]
    for name in names:
        (case.parent / name).write_bytes((case.parent / "frame.png").read_bytes())
    bpy.ops.oneframe.open_case(filepath=str(case))
    bpy.ops.oneframe.queue_frames(directory=str(case.parent), files=[{"name": name} for name in names])
    return case.parent / "queue"


def pose():
    return from_scene.cam_from_model(bpy.context.scene)


def move(shift_mm):
    settings = bpy.context.scene.oneframe
    surface_object.set_pose(settings.camera_object, settings.surface, rigid(np.eye(3), shift_mm) @ pose())


def states(queue):
    return [state_of(read_case(path, posed=False)) for path in queued_cases(queue)]


def test_each_frame_starts_at_the_pose_before_and_keeps_its_own(queue):
    assert [path.parent.name for path in queued_cases(queue)] == ["frame", "last", "later"]
    first = pose()
    assert bpy.ops.oneframe.queue_step() == {"FINISHED"}
    # a start only: the case stays new until somebody aligns it
    assert np.array_equal(pose(), first)
    assert pose_record(bpy.context.scene).method == "another frame"
    assert not bpy.context.scene.oneframe.landmarks
    refused(bpy.ops.oneframe.queue_check, "align it first")
    bpy.ops.oneframe.queue_step()
    assert states(queue) == [ROUGH, NEW, NEW]
    bpy.ops.oneframe.queue_step(step=-1)
    assert np.array_equal(pose(), first)
    move([1.0, 0.0, 0.0])
    second = pose()
    bpy.ops.oneframe.queue_step()
    assert np.array_equal(pose(), second)
    refused(bpy.ops.oneframe.queue_step, "last")
    move([0.0, 1.0, 0.0])
    bpy.ops.oneframe.queue_step(step=-2)
    assert np.allclose(pose(), first, atol=1e-9)
    bpy.ops.oneframe.queue_step()
    assert np.allclose(pose(), second, atol=1e-9)
    assert states(queue) == [ROUGH, ROUGH, ROUGH]
    # of the frames the latest one alone is among the recent cases
    assert [path for path in recent("cases") if queue in path.parents] == [queue / "last" / "case.toml"]


def test_a_checked_pose_is_recorded_in_its_case_until_it_moves(queue):
    bpy.ops.oneframe.queue_check()
    assert states(queue) == [CHECKED, NEW, NEW]
    bpy.ops.oneframe.queue_step(step=-1)
    bpy.ops.oneframe.save_case(filepath=bpy.context.scene.oneframe.case_path)
    assert states(queue)[0] == CHECKED
    move([1.0, 0.0, 0.0])
    bpy.ops.oneframe.queue_step()
    assert states(queue)[0] == ROUGH


def test_the_status_line_leads_through_the_queue_until_all_are_checked(queue):
    for _ in range(3):
        assert status(found_here())[0].endswith("Next: Checked, if it is right")
        bpy.ops.oneframe.queue_check()
    assert status(bpy.context.scene)[0].endswith("Next: oneframe render queue, which renders them all")
    entry = queued_cases(queue)[0]
    entry.write_text(entry.read_text().replace("checked =", "# checked ="))
    forget_stamps()
    assert status(bpy.context.scene)[0].endswith("Next: Next Unfinished goes to the next unfinished one")


def test_a_refused_frame_is_left_out_and_said_so_until_it_is_taken_back(queue, run_oneframe):
    bpy.ops.oneframe.queue_step()
    bpy.ops.oneframe.queue_refuse(reason=" blurred ")
    path = queued_cases(queue)[1]
    assert (read_case(path, posed=False).refused, states(queue)) == ("blurred", [ROUGH, REFUSED, NEW])
    bpy.ops.oneframe.queue_step(step=-1)
    bpy.ops.oneframe.queue_unfinished()
    assert queued.position(bpy.context.scene) == 2
    ended = run_oneframe("render", path, "--out", queue.parent / "views", "--count", "1")
    assert "refused: blurred; take it back in the window" in ended.stderr
    ended = run_oneframe("render", queue, "--out", queue.parent / "views", "--count", "1")
    assert "last: left out, it is refused: blurred" in ended.stdout
    assert ended.returncode
    bpy.ops.oneframe.queue_step(step=-1)
    bpy.ops.oneframe.queue_refuse(reason="")
    assert read_case(path, posed=False).refused == ""


def test_the_next_step_is_never_one_that_cannot_be(queue):
    scene = bpy.context.scene
    for pairs, words in ((1, "another pin"), (3, "refines it")):
        pose_evidence.remember(scene, PoseRecord(method="pins", pairs=pairs, rms_px=0.1), pose())
        assert words in status(scene)[0]
    bpy.ops.oneframe.queue_check()
    bpy.ops.oneframe.queue_step(step=-1)
    assert "refines it" not in status(scene)[0]


def found_here():
    pose_evidence.remember(bpy.context.scene, PoseRecord(REGISTERED, date="2026-01-01"), pose())
    return bpy.context.scene


def still_film(path, size_wh):
    image = np.full((*size_wh[::-1], 3), 128, np.uint8)
    image[::2, ::3] = 60
    return write_film(path, [image] * 3, "MJPG")


def test_frames_of_a_film_name_it_scale_k_and_lie_in_the_queue(queue):
    scene, film = bpy.context.scene, still_film(queue.parent / "film.avi", (128, 96))
    bpy.ops.oneframe.open_video(filepath=str(film))
    shown_frame.show(scene, 1)
    bpy.ops.oneframe.queue_video_frames()
    (path,) = set(queued_cases(queue)) - {queue / name / "case.toml" for name in ("frame", "last", "later")}
    case = read_case(path, posed=False)
    assert case.video == ("film.avi", 1)
    assert case.image.resolve().parent == queue.resolve()
    assert case.camera == from_scene.camera(scene).resized(128, 96)
    refused(bpy.ops.oneframe.queue_video_frames, "no case yet")


def test_frames_that_are_refused_change_nothing(addon, write_tiny_case, tmp_path):
    case = write_tiny_case(tmp_path / "case")
    bpy.ops.oneframe.open_case(filepath=str(case))
    scene = bpy.context.scene
    narrow = still_film(tmp_path / "case" / "narrow.avi", (32, 96))
    (case.parent / "Frame.png").write_bytes(encode_png(np.zeros((48, 64, 3), np.uint8)))
    (case.parent / "narrow.png").write_bytes(encode_png(np.zeros((48, 32, 3), np.uint8)))
    bpy.ops.oneframe.open_video(filepath=str(narrow))
    before = tree(tmp_path), sorted(tmp_path.rglob("*"))
    for add in (
        bpy.ops.oneframe.queue_video_frames,
        lambda: bpy.ops.oneframe.queue_frames(directory=str(case.parent), files=[{"name": "narrow.png"}]),
        lambda: bpy.ops.oneframe.queue_frames(directory=str(case.parent), files=[{"name": "Frame.png"}]),
    ):
        refused(add, r"expected")
        assert (tree(tmp_path), sorted(tmp_path.rglob("*"))) == before
        assert scene.oneframe.case_path == str(case)
        assert queued.queue_of(scene) == ()
