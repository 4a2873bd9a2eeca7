"""A CT in the add-on: the script's surface to the last bit, files beside the case, bad files."""

import json

import bpy
import numpy as np
import pytest

sitk = pytest.importorskip("SimpleITK")

from blender_addon.state import from_scene, to_scene
from blender_addon.state.landmarks import landmarks_mesh
from blender_addon.volume import ct
from oneframe.blender.alignment.surface_object import mesh_from_model_of
from oneframe.camera.pinhole import PinholeCamera
from oneframe.commands.__main__ import dispatch
from oneframe.images.png import encode_png
from oneframe.transforms import transform_points

SIZE, SPACING = (44, 40, 36), (0.5, 0.5, 0.6)
ORIGIN = np.array([-12.0, 30.0, 5.0])
CENTRE = ORIGIN + np.array(SPACING) * (np.array(SIZE) - 1) / 2


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """A ball of bone of 8 mm radius with a nerve through it, as CT and labels."""
    folder = tmp_path_factory.mktemp("ct")
    grid = np.stack(np.meshgrid(*[np.arange(count) for count in SIZE], indexing="ij")).T
    points = ORIGIN + grid * SPACING
    depth = 8.0 - np.linalg.norm(points - CENTRE, axis=-1)
    rng = np.random.default_rng(3)
    hu = np.clip(300 + 900 * depth, -1000, 1500) + rng.normal(0, 20, depth.shape)
    across = np.linalg.norm((points - CENTRE)[..., 1:], axis=-1)
    nerve = ((across < 1.0) & (depth > 1.0)).astype(np.uint8)
    for name, values in (("ct", hu.astype(np.int16)), ("labels", nerve)):
        image = sitk.GetImageFromArray(values)
        image.SetSpacing(SPACING)
        image.SetOrigin(ORIGIN.tolist())
        sitk.WriteImage(image, str(folder / f"{name}.nii.gz"))
    (folder / "labels.json").write_text('{"labels": {"facial nerve": 1}}')
    return folder


@pytest.fixture
def scene(addon, files):
    bpy.ops.oneframe.open_ct(filepath=str(files / "ct.nii.gz"))
    return bpy.context.scene


def with_labels(files):
    bpy.ops.oneframe.open_labels(filepath=str(files / "labels.nii.gz"))


def surface_bytes(scene):
    return from_scene.absolute_path(scene.oneframe.surface.oneframe.mesh_path).read_bytes()


def test_the_surface_is_the_scripts(scene, files, tmp_path):
    with_labels(files)
    bpy.ops.oneframe.make_surface()
    labels = ["--labels", str(files / "labels.nii.gz"), "--out"]
    dispatch(["surface", str(files / "ct.nii.gz"), *labels, str(tmp_path / "plain")])
    assert surface_bytes(scene) == (tmp_path / "plain" / "surface.ply").read_bytes()
    (nerve,) = scene.oneframe.surface.children
    assert nerve.name == "facial_nerve"
    made = from_scene.absolute_path(nerve.oneframe.mesh_path).read_bytes()
    assert made == (tmp_path / "plain" / "structures" / "facial_nerve.ply").read_bytes()


def test_pose_and_landmarks_stay_when_the_surface_is_made_again(scene, files):
    bpy.ops.oneframe.make_surface()
    surface = scene.oneframe.surface
    entry = scene.oneframe.landmarks.add()
    entry.has_point, entry.point = True, (1.0, 2.0, 3.0)
    before = landmarks_mesh(scene)[0].point
    world = np.array(surface.matrix_world) @ np.linalg.inv(mesh_from_model_of(surface))
    scene.oneframe_ct.threshold_hu = 900
    bpy.ops.oneframe.make_surface()
    assert scene.oneframe.surface == surface
    np.testing.assert_allclose(landmarks_mesh(scene)[0].point, before, atol=1e-5)
    after = np.array(surface.matrix_world) @ np.linalg.inv(mesh_from_model_of(surface))
    np.testing.assert_allclose(after, world, atol=1e-4)


def test_save_case_takes_the_surface_beside_it(scene, files, tmp_path, monkeypatch):
    with_labels(files)
    bpy.ops.oneframe.make_surface()
    (tmp_path / "frame.png").write_bytes(encode_png(np.full((60, 80, 3), 90, np.uint8)))
    bpy.ops.oneframe.load_frame(filepath=str(tmp_path / "frame.png"))

    to_scene.set_camera(bpy.context, PinholeCamera(80, 60, 400, 400, 39.5, 29.5), None)
    made = surface_bytes(scene)
    for _ in range(2):
        bpy.ops.oneframe.save_case(filepath=str(tmp_path / "case.toml"))
        assert (tmp_path / "surface.ply").read_bytes() == made
        assert (tmp_path / "structures" / "facial_nerve.ply").exists()
    # what is beside the case makes the same surface again
    record = json.loads((tmp_path / "surface_made_by.json").read_text())
    assert str(files) not in json.dumps(record), "no name of a file"
    named = {"CT": "ct.nii.gz", "LABELS": "labels.nii.gz"}
    words = [str(files / named[word]) if word in named else word for word in record["command"].split()]
    monkeypatch.chdir(tmp_path)
    dispatch(["surface", *words[2:-1], str(tmp_path / "again")])
    assert (tmp_path / "again" / "surface.ply").read_bytes() == made
    bpy.ops.oneframe.open_case(filepath=str(tmp_path / "case.toml"))
    assert len(scene.oneframe.surface.children) == 1


def test_the_blend_file_holds_a_path_and_the_voxels_are_read_again(scene, files, tmp_path):
    with_labels(files)
    bpy.ops.oneframe.make_surface()
    volume = ct.ct_of(scene).volume
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "kept.blend"), compress=False)
    assert volume.values[10, 10].tobytes() not in (tmp_path / "kept.blend").read_bytes()
    ct._loaded.clear()
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "kept.blend"))
    scene = bpy.context.scene
    assert ct.ct_of(scene) is None
    assert not bpy.ops.oneframe.make_surface.poll()
    bpy.ops.oneframe.open_ct(filepath=scene.oneframe_ct.path)
    assert len(ct.ct_of(scene).labels.names) == 1
    assert np.array_equal(ct.ct_of(scene).volume.values, volume.values)


def test_what_is_no_ct_changes_nothing(scene, files):
    before = ct.ct_of(scene)
    with pytest.raises(RuntimeError, match="label"):
        bpy.ops.oneframe.open_ct(filepath=str(files / "labels.nii.gz"))
    assert ct.ct_of(scene) is before
    assert scene.oneframe_ct.path == str(files / "ct.nii.gz")


def test_a_threshold_without_bone_changes_nothing(scene):
    scene.oneframe_ct.threshold_hu = 3000
    with pytest.raises(RuntimeError, match="HU"):
        bpy.ops.oneframe.make_surface()
    assert scene.oneframe.surface is None
    bpy.ops.oneframe.otsu()
    bpy.ops.oneframe.make_surface()
    corners = transform_points(mesh_from_model_of(scene.oneframe.surface), np.array(scene.oneframe.surface.bound_box))
    np.testing.assert_allclose(corners.mean(axis=0), CENTRE, atol=0.3)
