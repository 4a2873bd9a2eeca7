"""``make addon-dev``: the checkout's add-on in a real Blender, with a case opened."""

import sys
from pathlib import Path

import pytest

from scripts.dev import addon_dev

pytestmark = pytest.mark.window

SCRIPT = Path(addon_dev.__file__)
WAIT_FOR_CASE = """
import bpy, os
def look():
    scene = bpy.context.window_manager.windows[0].scene
    if hasattr(scene, "oneframe") and scene.oneframe.surface:
        print("opened", scene.oneframe.case_path, len(scene.oneframe.surface.data.polygons), flush=True)
        os._exit(7)
    return 0.2
bpy.app.timers.register(look, persistent=True)
"""


def test_opens_the_case_in_a_blender(run_in_window, blender, sample, extension_zip, tmp_path):
    script = tmp_path / "wait_for_case.py"
    script.write_text(WAIT_FOR_CASE)
    flags = ["--gpu-backend", "opengl", "-noaudio", "-P", script]
    command = [sys.executable, SCRIPT, "--blender", blender, "--case", sample, "--", *flags]
    status, output = run_in_window(command, 180)
    assert status == 7, output
    assert f"opened {sample} " in output
