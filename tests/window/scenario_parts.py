"""Frame, K and surface one by one, without a pose, to a saved case within a pixel: by pointer and keys, counted."""

import bpy
import numpy as np

bpy.ops.preferences.addon_enable(module="bl_ext.user_default.oneframe")

import scenario_first_session as first_session
from bl_ext.user_default.oneframe.pipeline.blender.alignment import surface_object
from bl_ext.user_default.oneframe.pipeline.case.case_file import read_case
from bl_ext.user_default.oneframe.pipeline.transforms import transform_points
from bl_ext.user_default.oneframe.setup.alignment_record import pose_record
from bl_ext.user_default.oneframe.state import from_scene

MOST_ACTIONS = 15


def load_parts(user):
    """Frame, K and surface, one by one; returns the number of actions."""
    frame, surface = (user.folder / name for name in ("photograph.png", "bone.ply"))
    frame.write_bytes((user.case.parent / "frame.png").read_bytes())
    surface.write_bytes((user.case.parent / "surface.ply").read_bytes())
    yield from user.open_sidebar("OneFrame")
    for name, path in (("frame", frame), ("camera", user.case), ("surface", surface)):
        yield from user.press(f"oneframe.load_{name}")
        yield from user.choose_file(path)
    yield from user.at_workbench()
    yield from user.until(lambda: bpy.context.scene.oneframe.surface is not None, "the surface")
    yield from user.redraw()
    return 6


def scenario(user):
    actions = yield from load_parts(user)
    scene = bpy.context.scene
    yield from user.picture("1_loaded")
    true = read_case(user.case).cam_from_mesh
    actions += yield from first_session.pin_features(
        user, first_session.points_of_features(scene, true), first_session.CLICK_PX
    )
    user.facts["px by pins"] = off_px(scene, true)
    yield from first_session.refine(user)
    user.facts["px refined"] = off_px(scene, true)
    yield from user.press("oneframe.save_case")
    yield from user.accept_file()
    actions += 4
    saved = user.folder / "case.toml"
    yield from user.until(saved.exists, "the case")
    user.facts["actions"] = actions
    assert actions <= MOST_ACTIONS
    assert off_px(scene, true) < 1.0, user.facts
    assert pose_record(scene)["method"] == read_case(saved).alignment["method"] == "refined"


def off_px(scene, true):
    """How far the surface is off, px: the median over what the frame shows of it."""
    surface, camera = from_scene.surface_of(scene), from_scene.camera(scene)
    vertices = np.array([vertex.co for vertex in surface.data.vertices][::20])
    poses = true @ surface_object.mesh_from_model_of(surface), from_scene.cam_from_model(scene)
    wanted, found = (camera.project(transform_points(pose, vertices)) for pose in poses)
    shown = ((wanted >= 0) & (wanted < camera.size_wh)).all(axis=1)
    return round(float(np.median(np.linalg.norm(found - wanted, axis=1)[shown])), 2)
