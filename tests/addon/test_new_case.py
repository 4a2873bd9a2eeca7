"""A case begun from nothing in the window: the same files as those of ``oneframe case``, complete in one folder."""

import json
import shutil
from pathlib import Path

import bpy
import cv2
import numpy as np
import pytest

from blender_addon.setup.alignment_record import pose_record
from blender_addon.state import from_scene, scene_files
from blender_addon.state.landmarks import landmarks_mesh
from blender_addon.video import shown_frame
from blender_addon.view.overlay import frame_image_of
from blender_addon.volume import ct
from oneframe.case.case_file import read_case
from oneframe.case.loaded_case import load_case
from oneframe.case.pose_record import PoseRecord
from oneframe.commands.__main__ import dispatch
from oneframe.files.content import content_named
from oneframe.images.png import encode_png
from tests.addon.conftest import pixels_of, refused
from tests.tree import tree
from tests.video.surgical_film import write_film
from tests.volume.ball_ct import write_ball_ct

K = {"fx": 900.0, "fy": 905.0, "cx": 47.0, "cy": 36.5, "width": 96, "height": 72, "distortion": [0.1, -0.05, 0, 0, 0]}


@pytest.fixture(scope="module")
def files(tmp_path_factory) -> Path:
    """A CT of a ball of bone with a nerve, a frame, a mask, K."""
    folder = tmp_path_factory.mktemp("given")
    write_ball_ct(folder)
    v, u = np.mgrid[:72, :96]
    codes = np.stack([(u * 37 + v * 11) % 256, (u * v) % 256, 255 - (u + v)], -1).astype(np.uint8)
    cv2.imwrite(str(folder / "photo.jpg"), codes)
    alpha = np.where(u < 90, 255, 0).astype(np.uint8)
    cv2.imwrite(str(folder / "masked.png"), np.dstack([codes, alpha]))
    (folder / "mask.png").write_bytes(encode_png((v >= 10).astype(np.uint8)))
    (folder / "camera.json").write_text(json.dumps(K))
    line = ["surface", folder / "ct.nii.gz", "--labels", folder / "labels.nii.gz"]
    assert dispatch([*map(str, line), "--out", str(folder / "surface")]) == 0
    return folder


def load(**loaded: Path) -> None:
    for name, path in loaded.items():
        assert getattr(bpy.ops.oneframe, f"load_{name}")(filepath=str(path)) == {"FINISHED"}


def assert_same_case(window: Path, command: Path, *more: str) -> None:
    """The same files to the last bit, but for the command's picture."""
    ours, theirs = tree(window), tree(command)
    assert theirs.pop("overlay.png")
    assert [name for name in more if ours.pop(name)] == list(more)
    assert ours == theirs


@pytest.mark.parametrize("frame", ["photo.jpg", "masked.png"])
def test_the_window_and_the_command_make_the_same_case(addon, files, tmp_path, frame):
    bpy.ops.oneframe.open_ct(filepath=str(files / "ct.nii.gz"))
    bpy.ops.oneframe.open_labels(filepath=str(files / "labels.nii.gz"))
    bpy.ops.oneframe.make_surface()
    load(frame=files / frame, mask=files / "mask.png", camera=files / "camera.json")
    scene, folder = bpy.context.scene, tmp_path / "window"
    folder.mkdir()
    assert scene_files.is_temporary(from_scene.absolute_path(scene.oneframe.frame_path))
    bpy.ops.oneframe.save_case(filepath=str(folder / "case.toml"), collect=True)
    line = ["case", "--surface", files / "surface", "--frame", files / frame, "--mask", files / "mask.png"]
    assert dispatch([*map(str, line), "--camera", str(files / "camera.json"), "--out", str(tmp_path / "command")]) == 0
    # what is beside the case makes the same surface again
    record = json.loads((folder / "surface_made_by.json").read_text())
    assert str(files) not in json.dumps(record), "no name of a file"
    named = {"CT": str(files / "ct.nii.gz"), "LABELS": str(files / "labels.nii.gz")}
    dispatch([*(named.get(word, word) for word in record["command"].split()[1:-1]), str(tmp_path / "again")])
    assert (tmp_path / "again" / "surface.ply").read_bytes() == (folder / "surface.ply").read_bytes()
    assert_same_case(folder, tmp_path / "command", "surface_made_by.json")
    # the scene has them too: nothing refers to what ends with the session
    before = tree(folder)
    bpy.ops.oneframe.save_case(filepath=str(folder / "case.toml"), collect=True)
    assert tree(folder) == before
    assert from_scene.loaded_case(scene).case.image == folder / "frame.png"


def test_a_surface_folder_opens_with_its_structures(addon, files, tmp_path):
    load(camera=files / "camera.json", surface=files / "surface" / "surface.json", frame=files / "photo.jpg")
    scene = bpy.context.scene
    (nerve,) = scene.oneframe.surface.children
    assert (nerve.name, tuple(nerve.color)[:3]) == ("facial_nerve", (1.0, 0.0, 1.0))
    before = tree(files)
    bpy.ops.oneframe.save_case(filepath=str(tmp_path / "case.toml"))
    # by reference, unless copies are asked for
    case = read_case(tmp_path / "case.toml")
    assert {case.image.resolve().parent, case.mesh.resolve().parent} == {files, files / "surface"}
    assert [path.name for path in tmp_path.iterdir()] == ["case.toml"]
    assert case.alignment == PoseRecord("initial guess")
    folder = tmp_path / "all"
    folder.mkdir()
    bpy.ops.oneframe.save_case(filepath=str(folder / "case.toml"), collect=True)
    line = ["case", "--surface", files / "surface", "--frame", files / "photo.jpg", "--camera", files / "camera.json"]
    assert dispatch([*map(str, line), "--out", str(tmp_path / "command")]) == 0
    assert_same_case(folder, tmp_path / "command")
    assert tree(files) == before


def test_files_in_the_folder_stay(addon, files, tmp_path):
    folder = tmp_path / "mine"
    shutil.copytree(files / "surface", folder)
    shutil.copy(files / "photo.jpg", folder / "view.jpg")
    load(camera=files / "camera.json", surface=folder / "surface.json", frame=folder / "view.jpg")
    before = tree(folder)
    bpy.ops.oneframe.save_case(filepath=str(folder / "case.toml"), collect=True)
    assert tree(folder).items() > before.items()
    assert tree(folder).keys() - before.keys() == {"case.toml"}
    assert read_case(folder / "case.toml").image.name == "view.jpg"


def test_a_mask_is_shown_in_blue_and_kept_with_the_case(addon, files, tmp_path):
    load(surface=files / "surface" / "surface.json", frame=files / "masked.png", camera=files / "camera.json")
    scene = bpy.context.scene

    def shown() -> np.ndarray:
        return pixels_of(frame_image_of(scene)) / 255

    own = shown()
    load(mask=files / "mask.png")
    blue = shown()
    # away from the outlines, which the lens moves
    assert np.array_equal(own[14:], blue[14:])
    assert (blue[:8, :80, 2] > 0.59).all()
    assert (own[20:60, 92:, 2] > 0.55).all()
    for wrong, message in (("masked.png", "together"), ("photo.jpg", "one other value"), ("camera.json", "image")):
        (tmp_path / "inverse.png").write_bytes(encode_png((np.mgrid[:72, :96][0] < 10).astype(np.uint8)))
        path = tmp_path / "inverse.png" if message == "together" else files / wrong
        before = scene.oneframe.frame_path
        refused(load, message, mask=path)
        assert scene.oneframe.frame_path == before
    # a dataset would outlive the file
    refused(bpy.ops.oneframe.render_dataset, r"frame: expected a file that lasts, found masked_masked.png.*Save Case")
    # kept although no copies are asked for: the masked frame is no file of the user's
    bpy.ops.oneframe.save_case(filepath=str(tmp_path / "case.toml"))
    case = read_case(tmp_path / "case.toml")
    assert case.image == tmp_path / "frame.png"
    loaded = load_case(case)
    assert not loaded.frame.valid[:8].any()
    assert loaded.frame.valid[14:68, 4:80].all()
    assert np.array_equal(shown(), blue)
    # opened again, it looks the same; another mask makes another frame
    bpy.ops.oneframe.open_case(filepath=str(tmp_path / "case.toml"))
    assert np.array_equal(shown(), blue)
    (tmp_path / "more.png").write_bytes(encode_png((np.mgrid[:72, :96][0] < 60).astype(np.uint8)))
    load(mask=tmp_path / "more.png")
    bpy.ops.oneframe.save_case(filepath=str(tmp_path / "case.toml"))
    case = read_case(tmp_path / "case.toml")
    assert case.image == content_named(tmp_path / "frame.png", case.image.read_bytes())
    assert (tmp_path / "frame.png").exists(), "undo goes back to it"
    assert not load_case(case).frame.valid[64:].any()
    bpy.ops.oneframe.open_case(filepath=str(tmp_path / "case.toml"))
    assert (shown()[64:, :80, 2] > 0.55).all()


def test_the_initial_pose_follows_the_surface_until_somebody_moves_it(addon, files):
    bpy.ops.oneframe.open_ct(filepath=str(files / "ct.nii.gz"))
    bpy.ops.oneframe.make_surface()
    load(camera=files / "camera.json", frame=files / "photo.jpg")
    scene = bpy.context.scene
    plain = from_scene.cam_from_model(scene)
    assert pose_record(scene) == PoseRecord("initial guess")
    scene.oneframe_ct.threshold_hu = 900
    bpy.ops.oneframe.make_surface()
    smaller = from_scene.cam_from_model(scene)
    assert not np.allclose(plain, smaller, rtol=1e-9)
    assert pose_record(scene) == PoseRecord("initial guess")
    bpy.ops.oneframe.change_units(units="m")
    bpy.ops.oneframe.change_units(units="mm")
    load(camera=files / "camera.json")
    np.testing.assert_allclose(from_scene.cam_from_model(scene), smaller, atol=1e-6)
    bpy.ops.oneframe.nudge(axis="x")
    moved = from_scene.cam_from_mesh(scene)
    scene.oneframe_ct.threshold_hu = 500
    bpy.ops.oneframe.landmark_set(point=(1.0, 2.0, 3.0))
    before = landmarks_mesh(scene)[0].point
    bpy.ops.oneframe.make_surface()
    np.testing.assert_allclose(from_scene.cam_from_mesh(scene), moved, atol=1e-6)
    np.testing.assert_allclose(landmarks_mesh(scene)[0].point, before, atol=1e-5)
    assert pose_record(scene).method == "manual"


def test_a_frame_of_a_video_is_copied(addon, files, tmp_path):
    write_film(tmp_path / "film.avi", [np.full((72, 96, 3), 40 * index, np.uint8) for index in range(4)], "MJPG")
    load(surface=files / "surface" / "surface.json", camera=files / "camera.json")
    bpy.ops.oneframe.open_video(filepath=str(tmp_path / "film.avi"))
    shown_frame.show(bpy.context.scene, 2)
    bpy.ops.oneframe.take_frame()
    folder = tmp_path / "case"
    folder.mkdir()
    bpy.ops.oneframe.save_case(filepath=str(folder / "case.toml"), collect=True)
    line = ["case", "--surface", files / "surface", "--frame", tmp_path / "film.avi", "--frame-number", 2]
    assert dispatch([*map(str, line), "--camera", str(files / "camera.json"), "--out", str(tmp_path / "command")]) == 0
    # the window keeps the film's name; the command copies no names
    written = (folder / "case.toml").read_text()
    assert 'video = "film.avi"\nvideo_frame = 2\n' in written
    (folder / "case.toml").write_text(written.replace('video = "film.avi"\nvideo_frame = 2\n', ""))
    assert_same_case(folder, tmp_path / "command")
    load(frame=files / "photo.jpg")
    bpy.ops.oneframe.save_case(filepath=str(tmp_path / "photo.toml"))
    assert read_case(tmp_path / "photo.toml").video is None


def test_the_blend_file_holds_a_path_and_the_voxels_are_read_again(addon, files, tmp_path):
    bpy.ops.oneframe.open_ct(filepath=str(files / "ct.nii.gz"))
    bpy.ops.oneframe.open_labels(filepath=str(files / "labels.nii.gz"))
    volume = ct.ct_of(bpy.context.scene).volume
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "kept.blend"), compress=False)
    assert volume.values[10, 10].tobytes() not in (tmp_path / "kept.blend").read_bytes()
    ct._loaded.clear()
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "kept.blend"))
    scene = bpy.context.scene
    assert ct.ct_of(scene) is None
    assert not bpy.ops.oneframe.make_surface.poll()
    bpy.ops.oneframe.open_ct(filepath=scene.oneframe_ct.path)
    assert np.array_equal(ct.ct_of(scene).volume.values, volume.values)
    assert len(ct.ct_of(scene).labels.names) == 1


def test_what_is_no_ct_or_has_no_bone_changes_nothing(addon, files):
    bpy.ops.oneframe.open_ct(filepath=str(files / "ct.nii.gz"))
    scene = bpy.context.scene
    before = ct.ct_of(scene)
    refused(bpy.ops.oneframe.open_ct, "label", filepath=str(files / "labels.nii.gz"))
    assert ct.ct_of(scene) is before
    assert scene.oneframe_ct.path == str(files / "ct.nii.gz")
    scene.oneframe_ct.threshold_hu = 3000
    refused(bpy.ops.oneframe.make_surface, "HU")
    assert scene.oneframe.surface is None
    bpy.ops.oneframe.otsu()
    bpy.ops.ed.undo_push(message="opened")
    assert bpy.ops.oneframe.make_surface() == {"FINISHED"}
    bpy.ops.ed.undo_push(message="surface")
    for step, is_there in ((bpy.ops.ed.undo, False), (bpy.ops.ed.redo, True)):
        step()
        assert (bpy.context.scene.oneframe.surface is not None) == is_there
