"""A real photograph of a cushion, K typed, a mesh in metres: pinned to a few pixels, by pointer and keys, counted."""

import json
from pathlib import Path

import bpy
import numpy as np

bpy.ops.preferences.addon_enable(module="bl_ext.user_default.oneframe")

import scenario_first_session as first_session
from bl_ext.user_default.oneframe.pipeline.alignment.posterior.next_click import visible_points
from bl_ext.user_default.oneframe.pipeline.blender.alignment import surface_object
from bl_ext.user_default.oneframe.pipeline.case.case_file import read_case
from bl_ext.user_default.oneframe.pipeline.transforms import transform_points
from bl_ext.user_default.oneframe.state import from_scene

DATA = "bloster"
FOLDER = Path(__file__).resolve().parents[3] / "shared" / "data" / DATA
FRAME, PINS, CLICK_SIGMA_PX = 5, 6, 2.0
MOST_ACTIONS, MOST_PX = 25, 3.0


def scenario(user):
    table = json.loads((FOLDER / "cameras.json").read_text())
    posed = table["frames"][FRAME]
    yield from user.open_sidebar("OneFrame")
    yield from user.press("load_frame")
    yield from user.choose_file(FOLDER / posed["color"])
    scene = bpy.context.scene
    for name in ("fx", "fy", "cx", "cy"):
        setattr(scene.oneframe.camera, name, str(table["color"][name]))
    with user.context():
        bpy.ops.oneframe.set_camera("EXEC_DEFAULT", True)
    yield from user.press("load_surface")
    yield from user.choose_file(FOLDER / "mesh_70k.ply")
    yield 1.0
    yield from user.picture("1_units")
    yield from user.key("RET", user.middle())
    # frame 2, K 5, surface 2, metres 1
    actions = 10
    yield from user.at_workbench()
    scene = bpy.context.scene
    assert scene.oneframe.units == "m"
    yield from user.picture("2_loaded")
    pose = np.array(posed["cam_from_world_refined"])
    pose[:3, 3] *= 1000
    mesh_from_model = surface_object.mesh_from_model_of(from_scene.surface_of(scene))
    true = pose @ mesh_from_model
    points = visible_points(from_scene.surface_in_file(scene), from_scene.camera(scene), true)
    features = far_apart(points)
    pixels = from_scene.camera(scene).project(transform_points(true, features))
    clicks = CLICK_SIGMA_PX * np.random.default_rng(1).normal(size=(PINS, 2))
    actions += yield from first_session.pin_features(user, list(zip(pixels, features, strict=True)), clicks)
    yield from user.press("save_case")
    yield from user.choose_file(user.folder / "case.toml")
    yield from user.until((user.folder / "case.toml").exists, "the case")
    actions += 2
    found = read_case(user.folder / "case.toml").cam_from_mesh @ mesh_from_model
    shown, wanted = (from_scene.camera(scene).project(transform_points(each, points)) for each in (found, true))
    user.facts |= {"px": float(np.median(np.linalg.norm(shown - wanted, axis=1))), "actions": actions}
    assert user.facts["px"] < MOST_PX, user.facts
    assert actions <= MOST_ACTIONS


def far_apart(points):
    """Some points of the surface, the first in its middle, each as far as can be from those before."""
    chosen = [int(np.linalg.norm(points - points.mean(axis=0), axis=1).argmin())]
    for _ in range(20):
        chosen.append(int(np.min(np.linalg.norm(points[:, None] - points[chosen], axis=2), axis=1).argmax()))
    return points[chosen]
