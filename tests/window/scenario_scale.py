"""At a large interface scale no text over the view is cut off."""

import bpy
import numpy as np
from bl_ext.user_default.oneframe.landmarks import tool
from bl_ext.user_default.oneframe.ui.keymap import LANDMARK_TOOL, MOVE_TOOL
from bl_ext.user_default.oneframe.ui.strokes import Strokes
from bl_ext.user_default.oneframe.video import session
from bl_ext.user_default.oneframe.view.zoom import free_rectangle, uncovered_rectangle

WINDOW = 1024, 640
SCALE = 1.6
"""In this window of 1024 pixels, as 2 is in one of 1280."""

TEXTS = {}
"""Text -> left and right end, in pixels of the window."""


def scenario(user):
    bpy.context.preferences.view.ui_scale = SCALE
    yield 0.5
    yield from user.open_case(user.case.with_name("unaligned.toml"))
    watch_texts(user)
    yield from user.redraw()
    for name, places in ((LANDMARK_TOOL, ((0.5, 0.4), (0.95, 0.1), (0.05, 0.1))), (MOVE_TOOL, ((0.5, 0.5),))):
        yield from user.take_tool(name)
        for place in places:
            low, high = free_rectangle(user.area)
            x, y = low + np.array(place) * (high - low)
            region = user.region()
            yield from user.move((region.x + x, region.y + y))
            yield from user.picture(f"1_{name.partition('.')[2]}_{place[0]}")
    check(user, "unaligned.toml", "Click a feature")

    bpy.context.scene.oneframe.surface.scale = 1.0, 1.0, 1.3
    yield from user.key("F", user.middle())
    yield 0.5
    yield from user.picture("2_error")
    yield from user.key("ESC")
    bpy.context.scene.oneframe.surface.scale = 1.0, 1.0, 1.0

    user.call("open_video", "INVOKE_DEFAULT", filepath=str(user.case.with_name("film.avi")))
    yield from user.until(lambda: session.of(user.window.scene) is not None, "the film")
    yield 0.5
    yield from user.picture("3_video")


def watch_texts(user):
    """Note where every text is drawn: at the pointer in pixels of the window, else of the view."""
    draw = Strokes.draw

    def noting(strokes):
        for at, text, _ in strokes._texts:
            left = at[0] if text in tool.instruction(bpy.context) else at[0] + user.region().x
            TEXTS[text] = left, left + strokes.width_of(text)
        draw(strokes)

    Strokes.draw = noting


def check(user, *expected):
    region = user.region()
    low, high = uncovered_rectangle(user.area)
    assert all(any(text.startswith(start) for text in TEXTS) for start in expected), TEXTS
    cut = {text: ends for text, ends in TEXTS.items() if ends[0] < region.x + low[0] or ends[1] > region.x + high[0]}
    assert not cut, (cut, region.x + low, region.x + high)
