"""Pose and landmarks belong to the frame in which they were found, whatever is loaded after it."""

from dataclasses import replace

import bpy
import cv2
import numpy as np
import pytest

from blender_addon.landmarks import solve
from blender_addon.mask.operators import frame_of
from blender_addon.setup.alignment_record import pose_record
from blender_addon.state import from_scene
from blender_addon.state.landmarks import landmarks_mesh
from blender_addon.video import shown_frame
from oneframe.case.case_file import read_case
from oneframe.case.case_history import earlier_cases
from oneframe.case.pose_record import PoseRecord
from oneframe.images.pixel_values import to_uint8
from oneframe.images.png import encode_png
from tests.addon.conftest import pin
from tests.video.surgical_film import write_film

POINTS = [[1.25, -7.5, 41.0], [10.25, -7.5, 41.0], [1.25, -17.5, 41.0], [15.25, -17.5, 38.0], [8.0, -12.0, 41.0]]


@pytest.fixture
def aligned(addon, folder):
    """The small case, aligned by pins in its frame; the pose is exactly theirs."""
    bpy.ops.oneframe.open_case(filepath=str(folder / "case.toml"))
    scene = bpy.context.scene
    pose = from_scene.cam_from_model(scene)
    for number, point in enumerate(np.array(POINTS) - np.mean(POINTS, axis=0)):
        pixel = from_scene.camera(scene).project((pose[:3, :3] @ point + pose[:3, 3])[None])[0]
        pin(scene, point, pixel + 0.3 * number)
    assert pose_record(scene).method in ("pins", "landmarks")
    return scene


@pytest.fixture
def other(folder):
    path = folder / "other.png"
    path.write_bytes(encode_png(np.ascontiguousarray(cv2.imread(str(folder / "frame.png"))[::-1])))
    return path


def state(scene):
    record = replace(pose_record(scene), tool="", date="")
    return record, landmarks_mesh(scene), from_scene.cam_from_model(scene).tolist()


def load(path):
    assert bpy.ops.oneframe.load_frame(filepath=str(path)) == {"FINISHED"}


def test_another_frame_starts_at_the_pose_says_so_and_gets_no_pixels(aligned, other, folder):
    bpy.ops.ed.undo_push(message="aligned")
    before = state(aligned)
    load(other)
    record, landmarks, pose = state(aligned)
    assert record == PoseRecord("another frame", doubt="found in another frame (frame.png)")
    assert pose == before[2]
    assert [landmark.point for landmark in landmarks] == [landmark.point for landmark in before[1]]
    assert not any(landmark.pixel for landmark in landmarks)
    assert solve.solution(aligned).alignment is None
    bpy.ops.oneframe.save_case(filepath=str(folder / "new.toml"))
    saved = read_case(folder / "new.toml")
    assert (saved.image, saved.alignment.doubt, saved.alignment.rms_px) == (other, record.doubt, None)
    # what was found in the frame before is in its history, and undo brings it back: here of Save Case, and of the nudge
    assert earlier_cases(folder / "case.toml")[0].case.landmarks == before[1]
    # and whoever aligns in this frame is not in doubt
    bpy.ops.oneframe.nudge(axis="x")
    assert pose_record(aligned).method == "manual"
    bpy.ops.ed.undo_push(message="nudged")
    for _ in range(2):
        bpy.ops.ed.undo()
    assert state(bpy.context.scene) == before


@pytest.mark.parametrize("by", ["alpha", "load_mask", "copy"])
def test_a_masked_version_of_the_frame_is_the_same_frame(aligned, folder, by):
    before = state(aligned)
    picture = cv2.imread(str(folder / "frame.png"))[..., ::-1]
    mask = np.full(picture.shape[:2], 255, np.uint8)
    mask[:9] = 0
    file = folder / "version.png"
    if by == "load_mask":
        file.write_bytes(encode_png(mask))
        bpy.ops.oneframe.load_mask(filepath=str(file))
        bpy.ops.oneframe.guess_mask()
        assert not frame_of(aligned).shown[:9].any(), "a guess adds to what was hidden"
        bpy.ops.oneframe.clear_mask()
        assert frame_of(aligned).shown.all()
        assert np.array_equal(to_uint8(frame_of(aligned).colours), picture)
        load(folder / "frame.png")
    else:
        file.write_bytes(encode_png(np.dstack([picture, mask]) if by == "alpha" else np.ascontiguousarray(picture)))
        load(file)
    assert state(aligned) == before


def test_the_case_names_the_film_of_its_frame(addon, folder):
    write_film(folder / "film.avi", [np.full((48, 64, 3), level, np.uint8) for level in (90, 120)], "MJPG")
    bpy.ops.oneframe.open_case(filepath=str(folder / "case.toml"))
    bpy.ops.oneframe.open_video(filepath=str(folder / "film.avi"))
    shown_frame.show(bpy.context.scene, 1)
    bpy.ops.oneframe.take_frame()
    for name in ("a.toml", "b.toml"):
        bpy.ops.oneframe.save_case(filepath=str(folder / name), save_as=True)
        assert read_case(folder / name).video == ("film.avi", 1)
        bpy.ops.oneframe.open_case(filepath=str(folder / name))
    load(folder / "frame.png")
    bpy.ops.oneframe.save_case(filepath=str(folder / "c.toml"))
    assert read_case(folder / "c.toml").video is None
