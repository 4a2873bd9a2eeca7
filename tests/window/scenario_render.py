"""After the alignment: project colours, preview poses and a view, render a dataset while the window is used."""

import json

import bpy
import numpy as np

bpy.ops.preferences.addon_enable(module="bl_ext.user_default.oneframe")

from bl_ext.user_default.oneframe.dataset import background_job
from bl_ext.user_default.oneframe.pipeline.blender.colour.surface_colour import colour_record
from bl_ext.user_default.oneframe.state import from_scene

VIEWS = 60
"""More than are rendered while a picture of the window is taken."""


def scenario(user):
    yield from user.open_case()
    scene = bpy.context.scene
    settings = scene.oneframe
    yield from user.open_sidebar("OneFrame")
    pose = from_scene.cam_from_model(scene)
    for mode in ("vertex", "texture"):
        with user.context():
            assert bpy.ops.oneframe.project_colour(mode=mode) == {"FINISHED"}
        yield from user.picture(f"1_colour_{mode}")
    # seen from elsewhere, the unseen surface is marked
    user.view.view_perspective = "PERSP"
    yield from user.redraw()
    with user.context():
        bpy.ops.view3d.view_selected() if bpy.context.selected_objects else bpy.ops.view3d.view_all()
        bpy.ops.oneframe.preview_poses()
    yield from user.picture("2_poses")
    user.view.view_perspective = "CAMERA"
    with user.context():
        bpy.ops.oneframe.preview_view()
    yield from user.picture("3_preview")
    assert np.array_equal(from_scene.cam_from_model(scene), pose)

    out = user.folder / "dataset"
    settings.dataset_out = str(out)
    settings.dataset.count, settings.dataset.scale = VIEWS, 0.25
    with user.context():
        bpy.ops.oneframe.render_dataset()
    yield from user.until(lambda: len(views(out)) >= 3, "views of the running job")
    yield from user.picture("4_running")
    yield from user.until(lambda: not running(), "the dataset to be finished")
    assert len(views(out)) == VIEWS
    assert json.loads((out / "dataset.json").read_text())["count"] == VIEWS
    assert (out / "contact_sheet.png").is_file()
    yield from user.picture("5_finished")
    yield from change_the_surface_meanwhile(user, scene)


def change_the_surface_meanwhile(user, scene):
    """Colours of a surface that another window has replaced are dropped, with a message."""
    with user.context():
        bpy.ops.oneframe.project_colour("INVOKE_DEFAULT", mode="vertex")
    yield from user.until(lambda: user.window.modal_operators, "colouring to begin")
    yield 0.3
    other = next((user.case.parent / "structures").glob("*.ply"))
    with user.context():
        assert bpy.ops.oneframe.load_surface("EXEC_DEFAULT", filepath=str(other)) == {"FINISHED"}
    yield from user.until(lambda: not user.window.modal_operators, "colouring to end")
    assert colour_record(scene.oneframe.surface) is None


def running():
    job = background_job.current()
    return job is not None and job.running


def views(out):
    """The finished views and their times."""
    return {path.name: path.stat().st_mtime_ns for path in out.glob("train_synt/*/frame/*.json")}
