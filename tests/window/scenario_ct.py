"""From a CT to its surface and a masked frame by hand: file dialog, undo, brush of the mask."""

import numpy as np
import x11
from user import part

SIZE, SPACING = (49, 49, 45), 0.6
MIDDLE = (np.array(SIZE) - 1) * SPACING / 2


def scenario(user):
    path = user.folder / "ct.nrrd"
    written_ct(path)
    yield from user.open_sidebar("OneFrame")
    yield from user.press("open_ct")
    yield from user.choose_file(path)
    yield from user.until(lambda: part("volume.ct").ct_of(user.window.scene) is not None, "the CT", 60)
    yield from user.at_workbench()
    yield from user.open_sidebar("OneFrame")
    yield from user.press("make_surface")
    yield from user.until(lambda: user.window.scene.oneframe.surface is not None, "the surface", 60)
    yield from user.undo(lambda: user.window.scene.oneframe.surface is None, "undo")
    yield from user.redo(lambda: user.window.scene.oneframe.surface is not None, "redo")
    user.call("load_frame", True, filepath=str(user.case.parent / "frame.png"))
    user.call("load_camera", True, filepath=str(user.case))
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


def written_ct(path):
    """A ball of bone, 10 mm in radius, with a hollow in it: NRRD, which needs no library."""
    index = np.stack(np.meshgrid(*[np.arange(count) for count in SIZE], indexing="ij")).T * SPACING
    depth = 10 - np.linalg.norm(index - MIDDLE, axis=-1)
    hollow = np.linalg.norm(index - MIDDLE - [5, 0, 0], axis=-1) - 2
    hu = np.clip(300 + 900 * np.minimum(depth, hollow), -1000, 1400).astype("<i2")
    lines = ["NRRD0004", "type: short", "dimension: 3", "space: left-posterior-superior", "encoding: raw"]
    lines += [f"space directions: ({SPACING},0,0) (0,{SPACING},0) (0,0,{SPACING})", "space origin: (0,0,0)"]
    lines += [f"sizes: {SIZE[0]} {SIZE[1]} {SIZE[2]}", "endian: little", ""]
    path.write_bytes(("\n".join(lines) + "\n").encode() + hu.tobytes())
