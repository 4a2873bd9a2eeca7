"""The lamp at the lens in the window: typed, undone, kept, refused, and previewed as the command renders it."""

import bpy
import numpy as np
import pytest

from blender_addon.colour.lamp import lamp_of, rows
from blender_addon.dataset import operators as dataset
from blender_addon.setup import autosave
from blender_addon.setup.case_in_scene import unsaved_parts
from oneframe.case.case_file import read_case
from oneframe.light.lens_light import LensLight
from tests.addon.test_dataset import case_path, opened, refused, script_job  # noqa: F401

pytestmark = pytest.mark.render

LAMP = {"lamp_cam_mm": (-13.04, 16.0, 2.0), "ambient": 0.07}


def numbers(light):
    return light and (light.lamp_cam_mm, light.ambient, light.falloff)


def test_a_typed_lamp_is_saved_undone_and_kept_aside(opened, case_path):  # noqa: F811
    typed, scene = ((-13.04, 16.0, 2.0), 0.07, 2.0), opened
    assert lamp_of(scene) is None
    bpy.ops.ed.undo_push(message="before")
    bpy.ops.oneframe.set_lamp(**LAMP)
    bpy.ops.ed.undo_push(message="lamp")
    assert numbers(lamp_of(scene)) == typed
    assert dict(rows(lamp_of(scene)))["Method"] == "typed"
    assert unsaved_parts(scene) == ("lamp",)
    autosave.keep_aside(scene)
    assert numbers(read_case(autosave.aside(case_path)).light) == typed
    bpy.ops.ed.undo()
    assert lamp_of(bpy.context.scene) is None
    bpy.ops.ed.redo()
    bpy.ops.oneframe.save_case(filepath=str(case_path))
    scene = bpy.context.scene
    assert read_case(case_path).light == lamp_of(scene)
    assert numbers(lamp_of(scene)) == typed
    assert unsaved_parts(scene) == ()
    bpy.ops.oneframe.clear_lamp()
    bpy.ops.oneframe.save_case(filepath=str(case_path))
    assert read_case(case_path).light is None


def test_the_lamp_of_the_file_stays_to_the_last_digit(opened, case_path):  # noqa: F811
    given = LensLight((-13.123456789, 0.1, 0.0), 0.0512345678, 1.9, {"method": "found", "explained": 0.8})
    law = f"lamp_cam_mm = {list(given.lamp_cam_mm)}\nambient = {given.ambient}\nfalloff = 1.9\n"
    case_path.write_text(f'{case_path.read_text()}\n[light]\n{law}method = "found"\nexplained = 0.8\n')
    bpy.ops.oneframe.open_case(filepath=str(case_path))
    assert lamp_of(opened) == given
    bpy.ops.oneframe.set_lamp(lamp_cam_mm=given.lamp_cam_mm, ambient=given.ambient, falloff=given.falloff)
    assert lamp_of(opened) == given


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"ambient": 1.2}, "ambient: expected a number from 0 to 1, found 1.2"),
        ({"falloff": -1.0}, "falloff: expected a number from 0 to 4"),
        ({"lamp_cam_mm": (600.0, 0.0, 0.0)}, "expected a lamp at the lens, at most 500 mm"),
        ({"lamp_cam_mm": (0.0, 0.0, float("nan"))}, "expected three finite numbers"),
        ({"lamp_cam_mm": (0.0, 0.0, 345.0)}, "at most half of the way to the surface"),
    ],
)
def test_a_lamp_out_of_range_is_refused(opened, change, message):  # noqa: F811
    refused(bpy.ops.oneframe.set_lamp, message, **(LAMP | change))
    assert lamp_of(opened) is None


def test_the_previewed_view_in_its_light_is_that_of_the_run(opened, case_path, tmp_path):  # noqa: F811
    opened.oneframe.dataset.light = "lens"
    refused(bpy.ops.oneframe.preview_view, "expected the lamp at the lens")
    bpy.ops.oneframe.set_lamp(**LAMP)
    bpy.ops.oneframe.preview_view()
    image, _, outdated = dataset.preview(opened)
    assert not outdated
    bpy.ops.oneframe.save_case(filepath=str(case_path))
    with script_job(case_path, tmp_path).renderer(threads=1) as renderer:
        expected = renderer.make(0).rendered.rgb
    found = np.empty(expected.shape[0] * expected.shape[1] * 4, np.float32)
    image.pixels.foreach_get(found)
    assert np.abs(found.reshape(*expected.shape[:2], 4)[::-1, :, :3] - expected).max() <= 0.5001 / 255
    bpy.ops.oneframe.set_lamp(**(LAMP | {"ambient": 0.2}))
    assert dataset.preview(opened)[2]
    bpy.ops.oneframe.set_lamp(**LAMP)
    # before and after
    opened.oneframe.dataset.light = "none"
    assert dataset.preview(opened) is None
    bpy.ops.oneframe.preview_view()
    before = dataset.preview(opened)[0]
    opened.oneframe.dataset.light = "lens"
    assert dataset.preview(opened)[0] == image != before
    assert not dataset.preview(opened)[2]
    bpy.ops.oneframe.clear_lamp()
    assert dataset.preview(opened)[2]
    opened.oneframe.dataset.light = "none"
    assert not dataset.preview(opened)[2]
