"""Keys that are Blender's, and the brush's."""

import bpy
import numpy as np
import x11
from bl_ext.user_default.oneframe.state import from_scene
from bl_ext.user_default.oneframe.ui.keymap import MASK_TOOL, MOVE_TOOL


def scenario(user):
    yield from user.open_case()
    user.plain_view()
    scene = user.window.scene
    yield from user.take_tool(MOVE_TOOL)
    start = from_scene.cam_from_model(scene)
    yield from user.key("PAGE_DOWN", user.middle(), ctrl=True)
    yield from user.until(lambda: "oneframe_workspace" not in user.window.workspace, "Blender's next workspace", 20)
    yield from user.key("PAGE_UP", ctrl=True)
    yield from user.at_workbench()
    yield from user.key("COMMA", user.middle(), ctrl=True)
    yield from user.until(lambda: len(bpy.context.window_manager.windows) == 2, "Blender's Preferences", 20)
    yield 0.5
    close_second_window()
    assert np.array_equal(from_scene.cam_from_model(scene), start)
    yield from user.key("COMMA", user.middle(), alt=True)
    yield from user.until(lambda: not np.array_equal(from_scene.cam_from_model(scene), start), "10 px of roll", 20)
    start = from_scene.cam_from_model(scene)[2, 3]
    yield from user.key("U", user.middle())
    yield from user.until(lambda: from_scene.cam_from_model(scene)[2, 3] > start, "a step away", 20)

    # ring and number follow the key, though the pointer rests
    yield from user.take_tool(MASK_TOOL)
    yield from user.move(user.middle())
    before = yield from user.look()
    size = scene.oneframe.mask_brush_px
    yield from user.key("LEFT_BRACKET")
    yield from user.until(lambda: scene.oneframe.mask_brush_px < size, "a smaller brush", 20)
    yield 0.5
    changed = (x11.capture() != before).any(axis=-1)
    x, y = user.middle()
    row = user.window.height - round(y)
    around, header = changed[row - 120 : row + 120, round(x) - 120 : round(x) + 120], user.region("TOOL_HEADER")
    top = user.window.height - header.y - header.height
    assert around.any(), "the ring"
    assert changed[top : top + header.height].any(), "the number in the header"


def close_second_window():
    with bpy.context.temp_override(window=bpy.context.window_manager.windows[1]):
        bpy.ops.wm.window_close()
