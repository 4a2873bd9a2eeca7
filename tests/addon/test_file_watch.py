"""Files that drawing depends on are looked at by a timer: a slow drive must not hold up the window."""

from pathlib import Path

import bpy
import pytest


@pytest.fixture
def planned(addon, write_tiny_case, tmp_path):
    bpy.ops.oneframe.open_case(filepath=str(write_tiny_case(tmp_path)))
    scene = bpy.context.scene
    scene.oneframe.preview_poses = 2
    bpy.ops.oneframe.preview_poses()
    return scene


@pytest.mark.render
def test_drawing_looks_at_no_file_and_the_timer_sees_the_change(planned, monkeypatch, tmp_path):
    from blender_addon.dataset import pose_preview
    from blender_addon.state import scene_files as file_watch

    def is_current():
        return pose_preview.is_current(planned, stamp=file_watch.known_stamp)

    assert is_current()
    with monkeypatch.context() as patched:
        patched.setattr(Path, "stat", lambda *_, **__: pytest.fail("looked at a file while drawing"))
        assert is_current()
    mesh = tmp_path / "surface.ply"
    mesh.write_bytes(mesh.read_bytes() + b" ")
    assert is_current()
    assert file_watch._watch() == file_watch.WATCH_S
    assert not is_current()
    mesh.unlink()
    file_watch._watch()
    assert not is_current()
    # nobody asks any more
    file_watch._watch()
    assert file_watch._watch() is None
