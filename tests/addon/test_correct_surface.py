"""Correct Surface in the add-on gives what the command gives, and leaves the case as it was."""

import bpy
import cv2
import pytest

from blender_addon.frames import found
from blender_addon.frames.correct_surface import corrected_folder
from blender_addon.setup.case_in_scene import unsaved_parts
from blender_addon.state import from_scene
from blender_addon.video import session
from oneframe.commands.__main__ import dispatch
from oneframe.files.tables import parsed_json
from oneframe.registration.pose_list import POSES, found_of
from oneframe.surface_correction import CASE
from tests.scripts.test_correct import written
from tests.video.surgical_film import write_film


@pytest.fixture
def scene(addon, tmp_path):
    """A case, and a film of eleven frames of it that are found."""
    case = written(tmp_path, 10)
    images = [cv2.imread(str(path)) for path in sorted((tmp_path / "registered").glob("*.png"))]
    film = write_film(tmp_path / "film.avi", images, "MJPG")
    bpy.ops.oneframe.open_case(filepath=str(case.path))
    bpy.ops.oneframe.open_video(filepath=str(film))
    scene = bpy.context.scene
    bpy.ops.oneframe.case_frame()
    begun = found.begun(scene, session.of(scene))
    entries = parsed_json((tmp_path / "registered" / POSES).read_bytes(), POSES)
    mesh_from_model = from_scene.mesh_from_model_of(scene.oneframe.surface)
    begun.frames |= found_of(entries, mesh_from_model, 1e3)
    begun.write()
    return scene


def test_the_operator_writes_what_the_command_writes(scene, tmp_path):
    before = {path: path.read_bytes() for path in (tmp_path / "case.toml", tmp_path / "surface.ply")}
    assert corrected_folder(scene, written=True) is None
    bpy.ops.oneframe.correct_surface()
    folder, by_command = corrected_folder(scene, written=True), tmp_path / "by_command"
    film, poses = session.of(scene).path, found.of(scene).file
    given = tmp_path / "case.toml", poses, "--video", film, "--out", by_command
    assert dispatch(["correct", *map(str, given)]) == 0
    assert {path.name: path.read_bytes() for path in folder.iterdir()} == {
        path.name: path.read_bytes() for path in by_command.iterdir()
    }
    assert {path: path.read_bytes() for path in before} == before
    assert unsaved_parts(scene) == ()
    bpy.ops.oneframe.open_case(filepath=str(folder / CASE))
    # poses that were found on the old surface are not those on this one
    assert found.of(bpy.context.scene) is None
    # what else lies there is not replaced
    (folder / "mine.txt").write_text("mine")
    bpy.ops.oneframe.open_case(filepath=str(tmp_path / "case.toml"))
    with pytest.raises(RuntimeError, match=r"found mine\.txt in it; rename that folder"):
        bpy.ops.oneframe.correct_surface()
