"""A queue in the window: every frame begins where the last one ended, is saved to its own case, and none is lost."""

import json

import bpy
import numpy as np
import pytest

from blender_addon.setup.alignment_record import pose_record
from blender_addon.state import from_scene
from oneframe.case.case_file import read_case
from oneframe.case.case_queue import CHECKED, NEW, ROUGH, queued_cases, state_of
from oneframe.transforms import rigid


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
    from oneframe.blender.alignment import surface_object

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
    assert pose_record(bpy.context.scene)["method"] == "another frame"
    assert not bpy.context.scene.oneframe.landmarks
    with pytest.raises(RuntimeError, match="align it first"):
        bpy.ops.oneframe.queue_check()
    bpy.ops.oneframe.queue_step()
    assert states(queue) == [ROUGH, NEW, NEW]
    bpy.ops.oneframe.queue_step(step=-1)
    assert np.array_equal(pose(), first)
    move([1.0, 0.0, 0.0])
    second = pose()
    bpy.ops.oneframe.queue_step()
    assert np.array_equal(pose(), second)
    with pytest.raises(RuntimeError, match="last"):
        bpy.ops.oneframe.queue_step()
    move([0.0, 1.0, 0.0])
    bpy.ops.oneframe.queue_step(step=-2)
    assert np.allclose(pose(), first, atol=1e-9)
    bpy.ops.oneframe.queue_step()
    assert np.allclose(pose(), second, atol=1e-9)
    assert states(queue) == [ROUGH, ROUGH, ROUGH]


def test_a_checked_pose_is_recorded_in_its_case_until_it_moves(queue):
    bpy.ops.oneframe.queue_check()
    assert states(queue) == [CHECKED, NEW, NEW]
    bpy.ops.oneframe.queue_step(step=-1)
    bpy.ops.oneframe.save_case(filepath=bpy.context.scene.oneframe.case_path)
    assert states(queue)[0] == CHECKED
    move([1.0, 0.0, 0.0])
    bpy.ops.oneframe.queue_step()
    assert states(queue)[0] == ROUGH


def test_frames_of_a_film_name_it_and_lie_in_the_queue(queue):
    from blender_addon.case_queue.operators import add_to_queue

    image = queue / "film_frame_000007.png"
    image.write_bytes((queue.parent / "frame.png").read_bytes())
    (path,) = add_to_queue(bpy.context.scene, [(image, ("film.mp4", 7))])
    assert read_case(path, posed=False).video == ("film.mp4", 7)
    assert len(queued_cases(queue)) == 4
    assert json.loads(bpy.context.scene.oneframe.case_files_text)[0].endswith("frame.png")
