"""What belongs to a frame, a surface or a case does not outlive it: pose and landmarks, file, what lies beside it."""

from dataclasses import replace

import bpy
import cv2
import numpy as np
import pytest

from blender_addon.dataset.operators import output_folder
from blender_addon.landmarks import solve
from blender_addon.mask.operators import frame_of
from blender_addon.setup.alignment_record import pose_record
from blender_addon.state import from_scene
from blender_addon.state.landmarks import landmarks_mesh
from oneframe.case.case_file import read_case
from oneframe.case.case_history import earlier_cases
from oneframe.case.pose_record import PoseRecord
from oneframe.images.pixel_values import to_uint8
from oneframe.images.png import encode_png
from tests.addon.conftest import pin, refused
from tests.video.surgical_film import write_film

NAMED = '\n[dataset]\nposes = "poses.npy"\n'


@pytest.fixture
def folders(write_tiny_case, tmp_path):
    """Two cases; the first has a name for its surface and a list of poses, and is open after a run."""
    for name in ("first", "second"):
        path = write_tiny_case(tmp_path / name)
    path = tmp_path / "first" / "case.toml"
    path.write_text(path.read_text().replace("[surface]", '[surface]\nname = "left ear"') + NAMED)
    np.save(path.with_name("poses.npy"), np.eye(4)[None])
    write_film(tmp_path / "film.avi", [np.full((48, 64, 3), 90, np.uint8)], "MJPG")
    return tmp_path


@pytest.fixture
def opened(addon, folders):
    bpy.ops.oneframe.open_case(filepath=str(folders / "first" / "case.toml"))
    bpy.context.scene.oneframe.dataset_out = str(folders / "first" / "dataset")
    bpy.ops.ed.undo_push(message="opened")
    return folders


def load(name, path):
    assert getattr(bpy.ops.oneframe, f"load_{name}")(filepath=str(path)) == {"FINISHED"}


def take_frame(film):
    bpy.ops.oneframe.open_video(filepath=str(film))
    assert bpy.ops.oneframe.take_frame() == {"FINISHED"}


WAYS = {
    "frame": lambda folders: load("frame", folders / "second" / "frame.png"),
    "frame of a video": lambda folders: take_frame(folders / "film.avi"),
    "surface": lambda folders: load("surface", folders / "second" / "surface.ply"),
}


@pytest.mark.parametrize("way", WAYS)
def test_another_frame_or_surface_ends_the_tie_to_file_and_dataset(opened, way):
    first = opened / "first" / "case.toml"
    text = first.read_bytes()
    WAYS[way](opened)
    bpy.ops.ed.undo_push(message="another")
    for step, ties in ((bpy.ops.ed.undo, (str(first), str(first.with_name("dataset")))), (bpy.ops.ed.redo, ("", ""))):
        step()
        settings = bpy.context.scene.oneframe
        assert (settings.case_path, settings.dataset_out) == ties
    assert output_folder(bpy.context.scene).parent != first.parent or way == "surface"
    refused(bpy.ops.oneframe.save_case, "found one of another ", filepath=str(first))
    assert first.read_bytes() == text
    other = opened / "other.toml"
    bpy.ops.oneframe.save_case(filepath=str(other))
    case = read_case(other)
    assert case.object_name == (None if way == "surface" else "left ear")
    assert opened / case.dataset["poses"] == opened / "first" / "poses.npy"


def test_the_tie_holds_while_frame_and_surface_do(opened):
    first = opened / "first" / "case.toml"
    load("frame", opened / "first" / "frame.png")
    load("camera", first)
    load("surface", opened / "first" / "surface.ply")
    bpy.ops.oneframe.change_units(units="m")
    assert bpy.context.scene.oneframe.case_path == str(first)
    bpy.ops.oneframe.save_case(filepath=str(first))
    assert (read_case(first).mm_per_unit, read_case(first).object_name) == (1000, "left ear")


def test_undo_does_not_bring_back_the_file_before(opened):
    bpy.ops.oneframe.save_case(filepath=str(opened / "copy.toml"))
    bpy.ops.oneframe.nudge(axis="x")
    bpy.ops.ed.undo_push(message="nudged")
    bpy.ops.ed.undo()
    assert bpy.context.scene.oneframe.case_path == str(opened / "copy.toml")


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
        if number == 0:
            assert (pose_record(scene).method, pose_record(scene).pairs) == ("pins", 1)
            assert pose_record(scene).rms_px < 0.02
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


def test_another_frame_starts_at_the_pose_says_so_and_gets_no_pixels(aligned, other, folder):
    bpy.ops.ed.undo_push(message="aligned")
    before = state(aligned)
    load("frame", other)
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
        load("frame", folder / "frame.png")
    else:
        file.write_bytes(encode_png(np.dstack([picture, mask]) if by == "alpha" else np.ascontiguousarray(picture)))
        load("frame", file)
    assert state(aligned) == before
