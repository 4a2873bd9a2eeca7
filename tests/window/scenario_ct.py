"""From a CT to the drilled surface by hand: slices, threshold, surface, strokes of the drill; the brush of the mask."""

import numpy as np
from mathutils import Matrix, Vector
from user import part

SIZE, SPACING = (49, 49, 45), 0.6
MIDDLE = (np.array(SIZE) - 1) * SPACING / 2


def scenario(user):
    path = user.folder / "ct.mha"
    written_ct(path)
    yield from user.open_sidebar("OneFrame")
    yield from user.show_step("ct")
    yield from user.press("open_ct")
    yield from user.choose_file(path)
    loaded, areas = part("volume.loaded"), part("volume.slice_areas")
    yield from user.until(lambda: loaded.ct_of(user.window.scene) is not None, "the CT", 60)
    yield from user.until(lambda: len(areas.slice_areas(user.window.screen)) == 3, "three slices", 30)
    yield from user.at_workbench()
    yield from user.picture("1_slices")

    # a click in one slice moves the others, the wheel leafs, the right button sets the window
    settings = user.window.scene.oneframe_ct
    top = max(areas.slice_areas(user.window.screen), key=lambda area: area.y)
    assert areas.plane_of(top.spaces.active) == 0
    region = user.region("WINDOW", top)
    middle = region.x + region.width / 2, region.y + region.height / 2
    x, y, z = settings.cursor_mm
    yield from user.click((middle[0] + 30, middle[1] + 20))
    assert settings.cursor_mm[0] > x, "right on the axial slice is the patient's left"
    assert settings.cursor_mm[1] < y, "up is the front"
    assert settings.cursor_mm[2] == z
    user.event("WHEELUPMOUSE", "PRESS", middle)
    yield from user.until(lambda: settings.cursor_mm[2] > z, "the next slice")
    assert np.isclose(settings.cursor_mm[2] - z, SPACING, atol=1e-4)
    width = settings.width_hu
    yield from user.drag(middle, (middle[0] + 40, middle[1]), "RIGHTMOUSE")
    assert settings.width_hu > width

    # the contour follows the threshold
    before = yield from user.look()
    settings.threshold_hu = 900
    yield 0.5
    after = yield from user.look()
    box = np.s_[
        user.window.height - region.y - region.height : user.window.height - region.y, region.x : region.x + 200
    ]
    assert (before[box] != after[box]).any()
    settings.threshold_hu = 300

    yield from user.open_sidebar("OneFrame")
    yield from user.press("make_surface")
    scene = user.window.scene
    yield from user.until(lambda: scene.oneframe.surface is not None, "the surface", 60)

    # undo takes the pictures of the slices away, which show again
    zooms = [area.spaces.active.zoom[0] for area in areas.slice_areas(user.window.screen)]
    yield from user.undo(lambda: user.window.scene.oneframe.surface is None, "undo")
    yield from user.until(lambda: len(areas.slice_areas(user.window.screen)) == 3, "the slices again", 30)
    yield 1.0
    again = [area.spaces.active.zoom[0] for area in areas.slice_areas(user.window.screen)]
    np.testing.assert_allclose(again, zooms, rtol=0.01)
    yield from user.redo(lambda: user.window.scene.oneframe.surface is not None, "redo")
    scene = user.window.scene

    # a stroke from the patient's left, undo and redo
    session = part("volume.drill_session")
    yield from user.press("drill")
    yield from user.until(lambda: session.of(scene) is not None, "the drill", 60)
    places = placed(user, scene)
    yield from user.redraw()
    yield from user.drag(*places[:2], steps=12)
    yield from user.until(lambda: strokes(user) == 1, "a stroke")
    yield from user.picture("3_drilled")
    drilled = blocks(user)
    yield from user.undo(lambda: strokes(user) == 0, "no stroke after undo")
    assert session.of(user.window.scene) is not None
    assert blocks(user) != drilled
    yield from user.redo(lambda: strokes(user) == 1, "the stroke after redo")
    assert blocks(user) == drilled

    # Esc takes back a stroke that is being drawn
    user.event("MOUSEMOVE", "NOTHING", places[0])
    user.event("LEFTMOUSE", "PRESS", places[0])
    yield 0.2
    user.event("MOUSEMOVE", "NOTHING", places[1])
    yield 0.2
    yield from user.key("ESC")
    user.event("LEFTMOUSE", "RELEASE", places[1])
    yield 0.2
    assert strokes(user) == 1
    assert blocks(user) == drilled

    # however fast the pointer is, the burr follows the bone; beside the bone it drills nothing, and says so
    kept = part("volume.drill_strokes").strokes_of(user.window.scene)
    for start, end in ((places[2], places[3]), (places[4], places[4])):
        user.event("MOUSEMOVE", "NOTHING", start)
        user.event("LEFTMOUSE", "PRESS", start)
        user.event("MOUSEMOVE", "NOTHING", end)
        user.event("LEFTMOUSE", "RELEASE", end)
        yield from user.redraw()
        yield 0.3
    *before, fast = part("volume.drill_strokes").strokes_of(user.window.scene)
    assert len(before) == len(kept) == 1
    off_middle = np.linalg.norm(fast.points - MIDDLE, axis=1)
    assert off_middle.min() > 9.5
    assert off_middle.max() < 11.5
    assert np.linalg.norm(np.diff(fast.points, axis=0), axis=1).max() < 2 * fast.radius_mm
    assert np.ptp(fast.points[:, 2]) > 12
    assert "0 mm³, not kept: no bone" in session.of(user.window.scene).said

    faces = len(user.window.scene.oneframe.surface.data.polygons)
    user.call("make_surface", "INVOKE_DEFAULT")
    # what is pressed meanwhile does nothing, and the header says so
    user.event("LEFTMOUSE", "PRESS", places[0])
    user.event("LEFTMOUSE", "RELEASE", places[0])
    yield from user.until(lambda: "Not ready" in str(part("ui.background_operator")._shown), "a refusal", 30)
    yield from user.until(lambda: not user.window.scene.oneframe_ct.drilling, "the drilled surface", 60)
    assert len(user.window.scene.oneframe.surface.data.polygons) != faces

    scene = user.window.scene
    user.call("load_frame", True, filepath=str(user.case.parent / "frame.png"))
    user.call("load_camera", True, filepath=str(user.case))
    yield from painting(user)
    yield from user.picture("4_masked_frame")


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


def written_ct(path):
    """A ball of bone, 10 mm in radius, with a hollow in it: MetaImage, which needs no library."""
    index = np.stack(np.meshgrid(*[np.arange(count) for count in SIZE], indexing="ij")).T * SPACING
    depth = 10 - np.linalg.norm(index - MIDDLE, axis=-1)
    hollow = np.linalg.norm(index - MIDDLE - [5, 0, 0], axis=-1) - 2
    hu = np.clip(300 + 900 * np.minimum(depth, hollow), -1000, 1400).astype("<i2")
    lines = ["ObjectType = Image", "NDims = 3", "BinaryData = True", "BinaryDataByteOrderMSB = False"]
    lines += [
        "TransformMatrix = 1 0 0 0 1 0 0 0 1",
        "Offset = 0 0 0",
        f"ElementSpacing = {SPACING} {SPACING} {SPACING}",
    ]
    lines += [f"DimSize = {SIZE[0]} {SIZE[1]} {SIZE[2]}", "ElementType = MET_SHORT", "ElementDataFile = LOCAL"]
    path.write_bytes(("\n".join(lines) + "\n").encode() + hu.tobytes())


def placed(user, scene):
    """Look from the patient's left; in the window, the ends of two strokes, and a place beside the ball."""
    world = part("volume.drill_session").world_from_mesh(scene)
    toward, up = (Vector(world[:3, :3] @ np.array(axis, float)) for axis in ((1, 0, 0), (0, 0, 1)))
    view = user.view
    view.view_rotation = Matrix((up.cross(toward), up, toward)).transposed().to_quaternion()
    offsets = [0, 0, 0], [10, 0, 2], [10, 0, -2], [7, 0, 7], [7, 0, -7], [0, 0, 12]
    middle, *at = (Vector(world[:3, :3] @ (MIDDLE + offset) + world[:3, 3]) for offset in offsets)
    view.view_location, view.view_distance = middle, 60
    view.update()
    return [user.of_point(each) for each in at]


def strokes(user):
    return len(part("volume.drill_strokes").strokes_of(user.window.scene))


def blocks(user):
    found = part("volume.drill_session").of(user.window.scene)
    return {key: (block.vertices.tobytes(), block.drilled.tobytes()) for key, block in found.blocks.items()}
