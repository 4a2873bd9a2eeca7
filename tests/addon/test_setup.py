"""Setting up a case through the add-on's operators: opening, saving, typing K, moving, refusals."""

import functools
import json

import bpy
import numpy as np
import pytest
from mathutils import Matrix

from blender_addon.colour.operators import is_outdated
from blender_addon.refine.status_line import status
from blender_addon.setup.alignment_record import doubts
from blender_addon.setup.case_in_scene import unsaved_parts
from blender_addon.state import from_scene, pose_evidence, to_scene
from blender_addon.state.scene_files import forget_stamps
from blender_addon.view.overlay_passes import world_from_structure
from oneframe.blender.alignment.surface_object import edited_mesh, mesh_from_model_of
from oneframe.case.case_changes import differing_fields
from oneframe.case.case_file import read_case
from oneframe.case.pose_record import PoseRecord
from oneframe.surface.mesh_writer import write_ply
from oneframe.transforms import is_same_pose
from tests.addon.conftest import refused
from tests.conftest import tiny_surface
from tests.tree import tree

MORE = """
[[frames]]
image = "frame.png"
cam_from_mesh = [[1, 0, 0, -10], [0, -1, 0, -7], [0, 0, -1, 340.5], [0, 0, 0, 1]]
[[structures]]
name = "zygoma"
mesh = "surface.ply"
color = "#00ff00"
[[structures]]
name = "antrum"
mesh = "surface.ply"
color = "#ff00ff"
[[landmarks]]
name = "A"
surface = [1.25, -7.5, 41.0]
pixel = [20.25, 30.5]
[[landmarks]]
name = "B"
pixel = [10.0, 12.0]
enabled = false
[light]
lamp_cam_mm = [-13.0, -16.0, 0.0]
ambient = 0.05
falloff = 2.0
method = "given"
[dataset]
count = 12
cone_deg = 30.5
"""


@pytest.fixture
def case_path(write_tiny_case, tmp_path):
    path = write_tiny_case(tmp_path)
    path.write_text(path.read_text().replace("[surface]", '[surface]\nname = "left ear"') + MORE)
    return path


def updated_pose(scene):
    bpy.context.view_layer.update()
    return from_scene.cam_from_model(scene)


def snapshot(scene):
    """Everything that a refused operator must leave unchanged."""
    settings = scene.oneframe
    camera = settings.camera_object
    return (
        [(found.name, found.type, [list(row) for row in found.matrix_world]) for found in bpy.data.objects],
        [(mesh.name, len(mesh.vertices)) for mesh in bpy.data.meshes],
        settings.frame_path,
        settings.case_path,
        [(entry.name, list(entry.point), list(entry.pixel)) for entry in settings.landmarks],
        None if camera is None else list(camera["oneframe_intrinsics"]["values"]),
    )


def test_typed_numbers_keep_every_digit(opened, case_path):
    typed = opened.oneframe.camera
    typed.fx, typed.fy, typed.cx, typed.distortion = "1081.37", "1081.370000123456", "31.4", "0.0123456789, 0, 0, 0, 0"
    bpy.ops.oneframe.set_camera()
    bpy.ops.oneframe.save_case(filepath=str(case_path))
    assert "1081.37," in case_path.read_text()
    case = read_case(case_path)
    assert (case.camera.fx, case.camera.fy, case.camera.cx) == (1081.37, 1081.370000123456, 31.4)
    bpy.ops.oneframe.open_case(filepath=str(case_path))
    bpy.ops.oneframe.set_camera()
    bpy.ops.oneframe.save_case(filepath=str(case_path))
    assert (read_case(case_path).camera, read_case(case_path).distortion) == (case.camera, case.distortion)


def test_a_case_with_changes_that_its_file_lacks_is_known(opened, case_path):
    assert unsaved_parts(opened) == ()
    bpy.ops.oneframe.nudge(axis="x")
    opened.oneframe.landmarks[0].name = "other"
    opened.oneframe.dataset.seed = 3
    assert set(unsaved_parts(opened)) == {"pose", "landmarks", "dataset options"}
    bpy.ops.oneframe.save_case(filepath=str(case_path))
    assert unsaved_parts(opened) == ()
    case_path.unlink()
    forget_stamps()
    assert unsaved_parts(opened) == ("all of it",)


def test_a_case_that_is_opened_and_saved_is_the_same(opened, case_path, tmp_path):
    """Also through a .blend file, and elsewhere."""
    copy = tmp_path / "elsewhere" / "copy.toml"
    copy.parent.mkdir()
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "work.blend"))
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "work.blend"))
    bpy.ops.oneframe.save_case(filepath=str(copy))
    assert differing_fields(read_case(case_path), read_case(copy)) == ()
    # the pose to the last bit, by which a run goes on: also one that was found here
    for _ in range(5):
        bpy.ops.oneframe.nudge(axis="yaw", step_px=1.7)
        bpy.ops.oneframe.save_case(filepath=str(copy))
        saved = read_case(copy).cam_from_mesh
        bpy.ops.oneframe.open_case(filepath=str(copy))
        assert np.array_equal(from_scene.cam_from_mesh(bpy.context.scene), saved)


def test_what_is_in_doubt_is_said_until_it_is_put_right(addon, case_path):
    folder = case_path.parent
    bpy.ops.oneframe.load_frame(filepath=str(folder / "frame.png"))
    bpy.ops.oneframe.load_camera(filepath=str(case_path))
    bpy.ops.oneframe.load_surface(filepath=str(folder / "surface.ply"), units="m")
    scene = bpy.context.scene
    size, guess = doubts(scene)
    assert "surface.ply: the surface is" in size
    assert "initial guess" in guess
    bpy.ops.oneframe.change_units(units="mm")
    assert doubts(scene) == (guess,)
    line, said = status(scene)
    assert line.startswith("frame.png, not saved  |  Initial guess")
    assert said == (guess,)
    bpy.ops.oneframe.nudge(axis="x")
    assert doubts(scene) == ()
    pose_evidence.remember(scene, PoseRecord("landmarks", doubt="two poses fit"), updated_pose(scene))
    assert doubts(scene) == ("The pose is in doubt: two poses fit.",)
    bpy.ops.oneframe.save_case(filepath=str(folder / "new.toml"))
    assert status(scene)[0].startswith("new.toml, saved  |  From landmarks")
    opened_again = read_case(folder / "new.toml")
    assert opened_again.alignment.doubt == "two poses fit"
    bpy.ops.oneframe.nudge(axis="x")
    assert status(scene)[0].startswith("new.toml, not saved: pose  |  By hand")


def test_a_scaled_surface_is_refused_until_the_scale_is_removed(opened, tmp_path):
    surface, operators = opened.oneframe.surface, bpy.ops.oneframe
    save = functools.partial(operators.save_case, filepath=str(tmp_path / "x.toml"))
    for kind, factors in (("scaled", (1.1, 1.1, 1.1)), ("scaled", (1, 1, 1.02)), ("mirrored", (-1, 1, 1))):
        origin = surface.matrix_world.translation.copy()
        surface.matrix_world = surface.matrix_world @ Matrix.Diagonal((*factors, 1.0))
        bpy.context.view_layer.update()
        for operator in (save, operators.nudge, operators.render_dataset):
            refused(operator, kind)
        assert not (tmp_path / "x.toml").exists()
        bpy.ops.oneframe.remove_scale()
        rotation = updated_pose(opened)[:3, :3]
        assert np.allclose(rotation @ rotation.T, np.eye(3), atol=1e-12)
        assert np.linalg.det(rotation) > 0
        assert (surface.matrix_world.translation - origin).length < 1e-4


def test_deleted_objects_are_reported(opened):
    bpy.data.objects.remove(opened.oneframe.surface)
    refused(bpy.ops.oneframe.save_case, "surface first", filepath="x.toml")
    refused(bpy.ops.oneframe.add_structure, "Load the surface first", filepath="x.ply")
    opened.collection.children[0].objects.unlink(opened.oneframe.camera_object)
    bpy.ops.oneframe.set_camera()
    assert opened.oneframe.camera_object.name in opened.objects


def exchange_edited(path):
    """Write the surface as it is edited to a file, and use that version of it."""
    surface = bpy.context.scene.oneframe.surface
    mesh = edited_mesh(surface).moved(mesh_from_model_of(surface)[:3, 3])
    write_ply(path, mesh)
    to_scene.exchange_surface(bpy.context, path, mesh)


def test_an_edited_surface_is_refused_and_another_version_keeps_pose_and_landmarks(opened, case_path, tmp_path):
    surface = opened.oneframe.surface
    before = updated_pose(opened)
    point = surface.matrix_world @ surface.data.vertices[7].co
    surface.data.vertices[0].co.z += 3.0
    refused(bpy.ops.oneframe.save_case, "edited in Blender", filepath=str(tmp_path / "edited.toml"))
    exchange_edited(tmp_path / "edited.ply")
    bpy.ops.oneframe.save_case(filepath=str(tmp_path / "edited.toml"))
    saved, given = read_case(tmp_path / "edited.toml"), read_case(case_path)
    assert saved.mesh.name == "edited.ply"
    # the file's frame is the same one, so its pose is too, though the mean of the vertices has moved
    assert np.allclose(saved.cam_from_mesh, given.cam_from_mesh, rtol=0, atol=1e-4)
    assert np.allclose(saved.landmarks[0].point, given.landmarks[0].point, atol=1e-4)
    bpy.context.view_layer.update()
    assert (surface.matrix_world @ surface.data.vertices[7].co - point).length < 1e-3
    assert not np.allclose(updated_pose(opened), before, atol=1e-6)


MISTAKES = [
    ("load_frame", "bad.png", b"not an image", "expected an image"),
    ("load_camera", "k.json", b'{"fx": 0}', "k.json"),
    ("open_video", "bad.mp4", b"", "it is empty"),
    ("open_case", "moved/case.toml", None, "does not exist"),
    ("load_pose", "pose.txt", b"-1 0 0 0 0 1 0 0 0 0 1 0 0 0 0 1", "reflection"),
    ("save_case", "", None, "expected a file"),
    ("save_case", "frame.png", None, "expected the name of a case file"),
]


def test_a_mistake_gives_one_message_and_leaves_the_scene(opened, case_path):
    folder = case_path.parent
    (folder / "moved").mkdir()
    (folder / "moved" / "case.toml").write_bytes(case_path.read_bytes())
    for operator, name, content, expected in MISTAKES:
        if content is not None:
            (folder / name).write_bytes(content)
        before, files = snapshot(opened), tree(folder)
        with pytest.raises(RuntimeError, match=expected) as caught:
            getattr(bpy.ops.oneframe, operator)(filepath=f"{folder}/{name}")
        assert "Traceback" not in str(caught.value)
        assert (snapshot(opened), tree(folder)) == (before, files)


def test_a_k_for_another_size_can_be_rescaled_also_after_the_frame(opened, tmp_path):
    k = from_scene.camera(opened)
    half = k.resized(k.width // 2, k.height // 2)
    path = tmp_path / "camera.json"
    path.write_text(json.dumps({name: getattr(half, name) for name in ("width", "height", "fx", "fy", "cx", "cy")}))
    bpy.ops.oneframe.load_camera(filepath=str(path))
    assert f"{half.width} x {half.height}" in to_scene.frame_warnings(opened)[0]
    bpy.ops.oneframe.rescale_camera()
    assert to_scene.frame_warnings(opened) == ()
    found = from_scene.camera(opened)
    assert np.allclose([found.fx, found.fy, found.cx, found.cy], [k.fx, k.fy, k.cx, k.cy], rtol=1e-12)


def test_structures_are_loaded_together_and_follow_the_surface(opened, case_path):
    folder, names = case_path.parent, ["facial_nerve", "ossicles", "structure_1"]
    files = ["DOE_facial_nerve.ply", "ossicles.ply", "DOE_JOHN.ply"]
    for name in files:
        write_ply(folder / name, tiny_surface())
    bpy.ops.oneframe.add_structure(directory=str(folder), files=[{"name": name} for name in files])
    surface = opened.oneframe.surface
    added = {child.name: child for child in surface.children if child.name in names}
    assert {name: tuple(child.color[:3]) for name, child in added.items()} == {
        "facial_nerve": (1, 0, 1),
        "ossicles": (0, 1, 1),
        "structure_1": (1, 1, 1),
    }
    surface.location.x += 5
    bpy.context.view_layer.update()
    assert all(np.allclose(world_from_structure(child), surface.matrix_world) for child in added.values())
    bpy.ops.oneframe.save_case(filepath=str(case_path))
    saved = [structure.name for structure in read_case(case_path).structures]
    assert saved == ["antrum", "facial_nerve", "ossicles", "structure_1", "zygoma"]


def test_units_can_be_changed_afterwards(opened, case_path, tmp_path):
    """Everything scales about the camera: each point stays at its pixel, and back again nothing has changed."""
    bpy.ops.oneframe.nudge(axis="roll", step_px=3)
    bpy.ops.oneframe.project_colour(mode="vertex")
    bpy.ops.oneframe.save_case(filepath=str(case_path))
    before, text = from_scene.case(opened, case_path), case_path.read_text()
    extents = from_scene.surface_extents(opened)
    bpy.ops.oneframe.change_units(units="m")
    bpy.context.view_layer.update()
    after = from_scene.case(opened, case_path)
    assert np.allclose(from_scene.surface_extents(opened), 1000 * extents, rtol=1e-6)
    # the numbers in the file are the same ones, in metres
    assert np.allclose(after.cam_from_mesh[:3, 3], 1000 * before.cam_from_mesh[:3, 3], rtol=1e-12)
    assert np.allclose(after.frames[0].cam_from_mesh[:3, 3], [-10_000, -7000, 340_500], rtol=1e-12)
    # single precision
    assert np.allclose(after.landmarks[0].point, 1000 * np.array(before.landmarks[0].point), rtol=1e-6)
    from_scene.check_mesh_unedited(opened)
    corner = np.array(opened.oneframe.surface.bound_box[0])
    pose = updated_pose(opened)
    pixel = before.camera.project((pose[:3, :3] @ corner + pose[:3, 3])[None])
    bpy.ops.oneframe.change_units(units="mm")
    bpy.context.view_layer.update()
    corner, pose = np.array(opened.oneframe.surface.bound_box[0]), updated_pose(opened)
    assert np.allclose(before.camera.project((pose[:3, :3] @ corner + pose[:3, 3])[None]), pixel, atol=1e-3)
    bpy.ops.oneframe.save_case(filepath=str(case_path))
    assert np.allclose(read_case(case_path).cam_from_mesh, before.cam_from_mesh, rtol=1e-12, atol=1e-9)
    assert case_path.read_text().count("[[landmarks]]") == text.count("[[landmarks]]")
    record = json.loads(opened.oneframe.surface["oneframe_colour"])
    assert is_same_pose(np.array(record["pose"]), from_scene.pose_in_file(opened))
    assert not is_outdated(opened, record)
