"""The preview of a refinement: before and after, discarded; a refused pose, which Enter alone does not take."""

import bpy
import numpy as np
from bl_ext.user_default.oneframe.pipeline.blender.alignment import surface_object
from bl_ext.user_default.oneframe.pipeline.images.image_reader import read_image
from bl_ext.user_default.oneframe.pipeline.images.pixel_values import to_uint8
from bl_ext.user_default.oneframe.pipeline.images.png import encode_png
from bl_ext.user_default.oneframe.pipeline.transforms import rigid, rotation_from_vector
from bl_ext.user_default.oneframe.setup.alignment_record import pose_record


def scenario(user):
    yield from user.open_case()
    user.plain_view()
    yield from user.open_sidebar("OneFrame")
    scene = bpy.context.scene
    start = rigid(rotation_from_vector(np.radians([1.0, -1.5, 1.0])), [1.0, -1.0, 2.0]) @ user.pose
    surface_object.set_pose(scene.oneframe.camera_object, scene.oneframe.surface, start)
    with user.context():
        bpy.ops.ed.undo_push(message="rough")
    yield from user.redraw()
    start = user.pose
    yield from preview(user, start)
    yield from user.key("ESC")
    yield 0.3
    assert np.array_equal(user.pose, start)
    assert pose_record(scene).method == "manual"

    mirrored = user.folder / "mirrored.png"
    image = to_uint8(read_image(user.case.parent / "frame.png")[0])[:, ::-1]
    mirrored.write_bytes(encode_png(np.ascontiguousarray(image)))
    user.call("load_frame", True, filepath=str(mirrored))
    refused = yield from preview(user, start)
    yield from user.picture("1_refused")
    yield from user.key("RET")
    yield from user.key("ESC")
    yield 0.3
    assert np.array_equal(user.pose, start)
    assert pose_record(scene).method == "another frame"
    again = yield from preview(user, start)
    assert np.array_equal(again, refused)
    yield from user.key("RET", user.middle(), ctrl=True)
    yield from user.until(lambda: pose_record(bpy.context.scene).refused, "the refused pose taken")


def preview(user, start):
    """F, then Space twice: the pose that was found, that before, and the found one again, which is returned."""
    yield from user.key("F", user.middle())
    yield from user.until(lambda: not np.array_equal(user.pose, start), "a pose that was found")
    found = user.pose
    for wanted in (start, found):
        yield from user.key("SPACE")
        yield from user.until(lambda wanted=wanted: np.array_equal(user.pose, wanted), "before and after")
    return found
