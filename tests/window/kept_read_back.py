"""The last start: the pose of the cross is there, is restored, saved and checked."""

import json

import bpy
import numpy as np
from bl_ext.user_default.oneframe.pipeline.case.case_file import read_case
from bl_ext.user_default.oneframe.state import from_scene


def scenario(user):
    second = user.case.parent / "queue" / "later_1" / "case.toml"
    wanted = json.loads((user.case.parent / "poses.json").read_text())["2"]
    yield from user.open_case(second)
    user.call("restore", "INVOKE_DEFAULT", True)
    scene = bpy.context.scene
    assert np.allclose(from_scene.cam_from_mesh(scene), wanted, atol=1e-9)
    yield from user.key("PAGE_DOWN", user.middle(), alt=True)
    yield from user.until(lambda: read_case(second).alignment.checked, "the checked pose in its file")
    assert np.allclose(read_case(second).cam_from_mesh, wanted, atol=1e-9)
