"""Refining in the window: the preview, landmarks and image solved together, a refused result."""

import bpy
import numpy as np

bpy.ops.preferences.addon_enable(module="bl_ext.user_default.oneframe")

from bl_ext.user_default.oneframe.pipeline.blender.alignment import surface_object
from bl_ext.user_default.oneframe.pipeline.images.image_reader import read_image
from bl_ext.user_default.oneframe.pipeline.images.pixel_values import to_uint8
from bl_ext.user_default.oneframe.pipeline.images.png import encode_png
from bl_ext.user_default.oneframe.pipeline.transforms import rigid, rotation_from_vector, transform_points
from bl_ext.user_default.oneframe.refine import operator
from bl_ext.user_default.oneframe.setup.alignment_record import pose_record
from bl_ext.user_default.oneframe.state import from_scene
from bl_ext.user_default.oneframe.ui.frame_view import surface_point_at

CLICKS_PX = np.array([(170, 250), (330, 190), (800, 190), (860, 560), (460, 540), (150, 600)], float)


def scenario(user):
    with user.context():
        bpy.ops.oneframe.open_case("EXEC_DEFAULT", True, filepath=str(user.case))
    yield from user.redraw()
    yield from user.open_sidebar("OneFrame")
    # to the panels that change
    with user.context("UI"):
        bpy.ops.view2d.pan(deltax=0, deltay=-10_000)
    true = pose()
    camera = from_scene.camera(bpy.context.scene)
    rng = np.random.default_rng(5)
    points = [surface_point_at(bpy.context.scene, pixel) for pixel in CLICKS_PX]
    with user.context():
        for point, pixel in zip(points, CLICKS_PX + rng.normal(0, 3, CLICKS_PX.shape), strict=True):
            if point is not None:
                bpy.ops.oneframe.landmark_set(True, point=point, pixel=pixel)
    yield from user.redraw()
    by_landmarks = pose()
    assert method() == "landmarks"
    yield from user.picture("1_by_landmarks")

    yield from user.key("F", user.middle())
    yield from user.until(lambda: not np.array_equal(pose(), by_landmarks), "a refined pose")
    refined = pose()
    yield from user.picture("2_preview")
    yield from user.key("SPACE")
    yield from user.until(lambda: np.array_equal(pose(), by_landmarks), "the pose before")
    yield from user.key("RET")
    yield from user.until(lambda: method() == "refined", "the refined pose accepted")
    joint = pose()
    assert not np.array_equal(joint, refined)
    assert pose_record(bpy.context.scene)["evidence"] == "landmarks, image"
    seen = [camera.project(transform_points(each, np.array(points))) for each in (pose(), true)]
    user.facts["refined to"] = round(float(np.linalg.norm(seen[0] - seen[1], axis=1).mean()), 2)
    user.facts["said to be"] = round(float(operator.outcome(bpy.context.scene).after.error_px), 2)
    yield from user.picture("3_refined")

    # a landmark dragged in the frame moves the surface a little: the image holds it
    start = user.of_pixel(*bpy.context.scene.oneframe.landmarks[0].pixel)
    with user.context():
        bpy.ops.wm.tool_set_by_id(name="oneframe.landmark_tool")
    yield from user.drag(start, (start[0] + 12, start[1] + 8))
    yield from user.until(lambda: not np.array_equal(pose(), joint), "the pose with the dragged landmark")
    moved = [camera.project(transform_points(each, np.array(points))) for each in (pose(), joint)]
    assert np.linalg.norm(moved[0] - moved[1], axis=1).max() < 3
    yield from user.picture("4_next_click")
    with user.context():
        bpy.context.scene.oneframe.use_image = False
    yield from user.until(lambda: method() == "landmarks", "the landmarks' pose")
    with user.context():
        bpy.context.scene.oneframe.use_image = True
    yield from user.until(lambda: method() == "refined", "the pose of both")
    refined = pose()

    # a refused result: Enter alone does not take it
    mirrored = user.folder / "mirrored.png"
    image = to_uint8(read_image(user.case.parent / "frame.png")[0])[:, ::-1]
    mirrored.write_bytes(encode_png(np.ascontiguousarray(image)))
    scene = bpy.context.scene
    start = rigid(rotation_from_vector(np.radians([1.0, -1.5, 1.0])), [1.0, -1.0, 2.0]) @ refined
    surface_object.set_pose(scene.oneframe.camera_object, scene.oneframe.surface, start)
    with user.context():
        bpy.ops.oneframe.load_frame(True, filepath=str(mirrored))
        bpy.ops.ed.undo_push(message="mirrored")
    yield from user.redraw()
    start = pose()
    yield from user.key("F", user.middle())
    yield from user.until(lambda: not np.array_equal(pose(), start), "a refused pose")
    refused = pose()
    yield from user.picture("5_refused")
    yield from user.key("RET")
    yield from user.key("SPACE")
    yield from user.until(lambda: np.array_equal(pose(), start), "the pose before the refused one")
    yield from user.key("ESC")
    yield 0.3
    assert np.array_equal(pose(), start)
    assert method() == "another frame"
    yield from call(user, bpy.ops.oneframe.take_refused)
    yield from user.until(lambda: np.array_equal(pose(), refused), "the refused pose once more")
    yield from user.key("RET", user.middle(), ctrl=True)
    yield from user.until(lambda: "refused" in pose_record(bpy.context.scene), "the refused pose taken")
    yield from user.picture("6_taken")


def pose():
    return from_scene.cam_from_model(bpy.context.scene)


def method():
    return pose_record(bpy.context.scene)["method"]


def call(user, action):
    """Call an operator as its button does."""
    yield from user.move(user.middle())
    with user.context():
        action("INVOKE_DEFAULT", True)
    yield 0.5
