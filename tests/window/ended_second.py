"""The next start: one question, Restore, and the pose that nobody had saved is there."""

import json
from pathlib import Path

import bpy
import numpy as np
from bl_ext.user_default.oneframe.pipeline.case.case_file import read_case
from bl_ext.user_default.oneframe.setup import autosave
from bl_ext.user_default.oneframe.setup.case_in_scene import unsaved_parts
from bl_ext.user_default.oneframe.state import from_scene

RESTORE = 117, 26
"""The button: the question opens at the pointer, which has not moved yet."""


def scenario(user):
    left = autosave.left_behind()
    poses = json.loads((left.parents[3] / "folder" / "poses.json").read_text())
    yield autosave.START_S + 1
    yield from user.picture("1_question")
    yield from user.click(RESTORE)
    yield from user.until(lambda: bpy.context.scene.oneframe.case_path, "the case")
    yield from user.redraw()
    yield from user.picture("2_restored")
    scene = bpy.context.scene
    for path, pose in poses.items():
        found = (
            from_scene.cam_from_mesh(scene) if path == scene.oneframe.case_path else read_case(Path(path)).cam_from_mesh
        )
        assert np.array_equal(found, pose), path
    assert unsaved_parts(scene) == ("pose", "landmarks")
    user.call("save_case", filepath=scene.oneframe.case_path)
    assert unsaved_parts(scene) == ()
    assert not left.exists()
