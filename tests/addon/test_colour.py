"""Colours on the surface: the pipeline's values; replacing, removing, undo, marking unseen surface."""

import json
from collections import Counter

import bpy
import numpy as np
import pytest
from mathutils import Matrix

from blender_addon.colour import operators
from oneframe.case.case_file import read_case
from oneframe.case.loaded_case import load_case
from oneframe.colour.reference_view import baked_colour_of, reference_view
from oneframe.images.masked_frame import UNSEEN
from oneframe.images.png import encode_png
from tests.addon.conftest import pixels_of, refused
from tests.codes import codes_from_linear

pytestmark = pytest.mark.render

KINDS = ("images", "materials", "meshes", "objects", "scenes", "cameras", "node_groups")
BLENDERS_OWN = ("Render Result", "Viewer Node")


def blocks() -> Counter:
    """Number of data-blocks by type and base name."""
    found = ((kind, block.name.split(".")[0]) for kind in KINDS for block in getattr(bpy.data, kind))
    return Counter(entry for entry in found if entry[1] not in BLENDERS_OWN)


def source_and_colour(case_path, mode):
    source = reference_view(load_case(read_case(case_path)))
    return source, baked_colour_of(source, mode)[0]


def vertex_colours(surface) -> np.ndarray:
    """``(V, 4)``: code values, and the observed flag."""
    attribute = surface.data.color_attributes["frame_colour"]
    rgba = np.empty(4 * len(attribute.data), np.float32)
    attribute.data.foreach_get("color", rgba)
    rgba = rgba.reshape(-1, 4)
    return np.concatenate([codes_from_linear(rgba[:, :3]), rgba[:, 3:]], axis=1)


def attribute_values(surface, name, member, kind, width) -> np.ndarray:
    attribute = surface.data.attributes[name]
    values = np.empty(width * len(attribute.data), kind)
    attribute.data.foreach_get(member, values)
    return values.reshape(-1, width)


def shown_image(surface) -> bpy.types.Image:
    return surface.data.materials[0].node_tree.nodes.active.image


def test_vertex_colours_are_those_of_the_script(opened, case_path):
    assert bpy.ops.oneframe.project_colour(mode="vertex") == {"FINISHED"}
    surface = opened.oneframe.surface
    _, colour = source_and_colour(case_path, "vertex")
    assert 0.3 < colour.observed.mean() < 1
    found = vertex_colours(surface)
    assert np.array_equal(found[:, 3] == 1, colour.observed)
    assert np.abs(found[:, :3] - colour.rgb)[colour.observed].max() < 1e-6
    np.testing.assert_allclose(found[~colour.observed, :3], np.tile(UNSEEN, (np.sum(~colour.observed), 1)), atol=1e-6)
    flags = attribute_values(surface, "frame_observed", "value", bool, 1)[:, 0]
    assert np.array_equal(flags, colour.observed)
    assert surface.data.color_attributes.active_color_name == "frame_colour"
    record = json.loads(surface["oneframe_colour"])
    assert record["mode"] == "vertex"
    assert 0.3 < record["of_surface"] < record["of_view"] <= 1
    assert not operators.is_outdated(opened, record)
    surface.matrix_world = Matrix.Translation((0.5, 0, 0)) @ surface.matrix_world
    bpy.context.view_layer.update()
    assert operators.is_outdated(opened, record)


def test_texture_is_that_of_the_script(opened, case_path):
    bpy.ops.ed.undo_push(message="before")
    bpy.ops.oneframe.project_colour(mode="texture")
    surface = opened.oneframe.surface
    _, atlas = source_and_colour(case_path, "texture")
    assert np.allclose(attribute_values(surface, "frame_uv", "vector", np.float32, 2), atlas.uv.reshape(-1, 2))
    image = shown_image(surface)
    assert image.packed_file is not None
    found = pixels_of(image)
    assert np.abs(found - 255 * atlas.image)[atlas.observed].max() <= 0.5001
    assert np.ptp(found[~atlas.observed], axis=0).max() == 0
    assert surface.data.uv_layers.active.name == "frame_uv"
    # an undo step, and in the .blend file
    bpy.ops.ed.undo_push(message="texture")
    bpy.ops.ed.undo()
    assert "oneframe_colour" not in bpy.context.scene.oneframe.surface
    bpy.ops.ed.redo()
    bpy.ops.wm.save_as_mainfile(filepath=str(case_path.with_name("saved.blend")))
    bpy.ops.wm.open_mainfile(filepath=str(case_path.with_name("saved.blend")))
    assert np.array_equal(pixels_of(shown_image(bpy.context.scene.oneframe.surface)), found)


def test_projecting_again_replaces_the_colours_and_plain_removes_them(opened):
    surface = opened.oneframe.surface
    plain, names = blocks(), {attribute.name for attribute in surface.data.attributes}
    material = surface.data.materials[0]
    seen = {}
    for mode in ("vertex", "texture", "texture", "vertex", "texture", "vertex"):
        bpy.ops.oneframe.project_colour(mode=mode)
        assert blocks() == seen.setdefault(mode, blocks())
    bpy.ops.oneframe.plain_surface()
    assert blocks() == plain
    assert {attribute.name for attribute in surface.data.attributes} == names
    assert surface.data.materials[:] == [material]
    assert not [key for key in surface.keys() if key.startswith(("oneframe_colour", "oneframe_plain"))]  # noqa: SIM118


def test_refusals_change_nothing(addon, opened, case_path):
    surface, before = opened.oneframe.surface, blocks()
    bpy.context.view_layer.objects.active = surface
    bpy.ops.object.mode_set(mode="EDIT")
    refused(bpy.ops.oneframe.project_colour, "expected Object mode, found Edit mode")
    bpy.ops.object.mode_set(mode="OBJECT")
    refused(bpy.ops.oneframe.plain_surface, "Project colour on the surface first")
    # out of the frame
    surface.matrix_world = Matrix.Translation((500, 0, 0)) @ surface.matrix_world
    bpy.context.view_layer.update()
    refused(bpy.ops.oneframe.project_colour, "expected the surface in the frame")
    assert blocks() == before
    (case_path.parent / "frame.png").write_bytes(encode_png(np.zeros((10, 10, 3), np.uint8)))
    refused(bpy.ops.oneframe.project_colour, "64x48")
    bpy.data.objects.remove(surface)
    refused(bpy.ops.oneframe.project_colour, "Set up a frame")
