"""The brush of the mask by hand: a strip hidden, taken back, redone, shown again; its ring follows the keys."""

import numpy as np
import x11
from user import part


def scenario(user):
    yield from user.open_case()
    user.plain_view()
    yield from user.open_sidebar("OneFrame")
    yield from painting(user)
    yield from user.picture("masked_frame")


def painting(user):
    """Hide a strip with the brush, take it back, redo it, and show a spot in its middle again."""

    def shown():
        return part("mask.operators").frame_of(user.window.scene).shown

    def stroke(start, end, **modifiers):
        before = user.window.scene.oneframe.frame_path
        yield from user.drag(user.of_pixel(*start), user.of_pixel(*end), **modifiers)
        yield from user.until(lambda: user.window.scene.oneframe.frame_path != before, "the painted mask", 20)

    yield from user.take_tool("oneframe.mask_tool")
    untouched = shown()
    yield from stroke((500, 200), (700, 300))
    strip = shown()
    assert not strip[[200, 300], [500, 700]].any()
    assert not (strip & ~untouched).any()
    yield from user.key("Z", ctrl=True)
    assert np.array_equal(shown(), untouched)
    yield from user.key("Z", ctrl=True, shift=True)
    assert np.array_equal(shown(), strip)
    yield from stroke((600, 250), (601, 250), ctrl=True)
    assert shown()[250, 600]
    assert not shown()[200, 500]

    # ring and number follow the key, though the pointer rests
    yield from user.move(user.middle())
    before, size = (yield from user.look()), user.window.scene.oneframe.mask_brush_px
    yield from user.key("LEFT_BRACKET")
    yield from user.until(lambda: user.window.scene.oneframe.mask_brush_px < size, "a smaller brush", 20)
    yield 0.5
    changed = (x11.capture() != before).any(axis=-1)
    x, y = user.middle()
    row, header = user.window.height - round(y), user.region("TOOL_HEADER")
    assert changed[row - 120 : row + 120, round(x) - 120 : round(x) + 120].any(), "the ring"
    top = user.window.height - header.y - header.height
    assert changed[top : top + header.height].any(), "the number in the header"
