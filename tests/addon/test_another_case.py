"""Nothing that a case remembers outlives its frame or surface: neither its file nor what lies beside that."""

import bpy
import numpy as np
import pytest

from blender_addon.dataset.operators import output_folder
from oneframe.case.case_file import read_case
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
    with pytest.raises(RuntimeError, match="found one of another "):
        bpy.ops.oneframe.save_case(filepath=str(first))
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


def test_a_file_that_has_become_another_case_meanwhile_is_not_replaced(opened):
    """As after opening an old .blend file."""
    first = opened / "first" / "case.toml"
    bpy.ops.wm.save_as_mainfile(filepath=str(opened / "work.blend"))
    text = first.read_text().replace("frame.png", "../second/frame.png")
    first.write_text(text)
    bpy.ops.wm.open_mainfile(filepath=str(opened / "work.blend"))
    assert bpy.context.scene.oneframe.case_path == str(first)
    with pytest.raises(RuntimeError, match=r"found one of another frame \(frame.png\); choose another name"):
        bpy.ops.oneframe.save_case(filepath=str(first))
    assert first.read_text() == text
