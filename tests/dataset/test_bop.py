"""BOP's files hold what its readers expect, and boxes are those counted pixel by pixel."""

import json

import numpy as np
import pytest
from hypothesis import given

from oneframe.dataset.tables.bop import EVAL_VERTICES, bounding_box, write_models
from oneframe.surface.decimation import reduced_mesh
from oneframe.surface.mesh_reader import read_mesh
from tests.conftest import grid_mesh
from tests.dataset.masks import masks
from tests.dataset.synthetic_dataset import SCENES, pose_of, scene_tables


@given(masks)
def test_boxes_are_those_counted_pixel_by_pixel(mask):
    pixels = [(int(x), int(y)) for y, x in np.argwhere(mask)]
    if pixels:
        left, top = (min(pixel[axis] for pixel in pixels) for axis in (0, 1))
        right, bottom = (max(pixel[axis] for pixel in pixels) for axis in (0, 1))
        assert bounding_box(mask) == (left, top, right - left, bottom - top)
    else:
        assert bounding_box(mask) == (-1, -1, -1, -1)


@pytest.mark.parametrize(("scene", "views"), SCENES)
def test_scene_tables_have_the_entries_of_bop(sound, scene, views):
    """Names and nesting of bop_toolkit's docs/bop_datasets_format.md and inout.load_scene_gt/camera."""
    tables = scene_tables(sound, scene)
    assert tables.keys() == {"scene_camera", "scene_gt", "scene_gt_info", "scene_gt_coco_modal"}
    for name in ("scene_camera", "scene_gt", "scene_gt_info"):
        assert list(tables[name]) == [str(image) for image in range(len(views))]
    for image, view in enumerate(views):
        pose, (truth,), (info,) = pose_of(view), tables["scene_gt"][str(image)], tables["scene_gt_info"][str(image)]
        assert truth.keys() == {"cam_R_m2c", "cam_t_m2c", "obj_id"}
        np.testing.assert_array_equal(np.reshape(truth["cam_R_m2c"], (3, 3)), pose[:3, :3])
        np.testing.assert_array_equal(truth["cam_t_m2c"], pose[:3, 3])
        camera = tables["scene_camera"][str(image)]
        assert camera.keys() == {"cam_K", "depth_scale", "cam_R_w2c", "cam_t_w2c"}
        assert camera["cam_K"] == [151.3, 0, 30.2, 0, 147.9, 25.1, 0, 0, 1]
        counts = {"px_count_all", "px_count_valid", "px_count_visib"}
        assert info.keys() == {"bbox_obj", "bbox_visib", "visib_fract", *counts}


def test_models_and_their_info(tmp_path):
    """The whole surface, and one reduced to a size that errors over all vertices are summed for."""
    rng = np.random.default_rng(4)
    x, y = np.meshgrid(np.linspace(-30, 30, 171), np.linspace(-25, 25, 141))
    mesh = grid_mesh(x, y, 3 * np.sin(x / 3) * np.cos(y / 5))
    mesh = mesh.moved(-mesh.vertices.mean(axis=0))
    colours = rng.integers(0, 256, mesh.vertices.shape).astype(np.uint8)
    write_models(tmp_path, mesh, colours)
    read, _ = read_mesh(tmp_path / "models" / "obj_000001.ply")
    np.testing.assert_allclose(read.vertices, mesh.vertices, rtol=1e-6, atol=1e-9)
    np.testing.assert_array_equal(read.faces, mesh.faces)
    reduced, messages = read_mesh(tmp_path / "models_eval" / "obj_000001.ply")
    assert not messages
    assert 2_000 < len(reduced.vertices) <= EVAL_VERTICES < len(mesh.vertices)
    spacing = 60 / 170
    near = np.abs(mesh.vertices[:, None, :2] - reduced.vertices[None, ::50, :2]).max(axis=2) < spacing
    assert near.any(axis=0).all()
    heights = np.where(near, mesh.vertices[:, None, 2], np.nan)
    off = np.abs(np.nanmean(heights, axis=0) - reduced.vertices[::50, 2])
    assert off.max() < 2 * spacing
    vertices = mesh.vertices.astype(np.float32).astype(float)
    outer = vertices[np.linalg.norm(vertices, axis=1) > 0.9 * np.linalg.norm(vertices, axis=1).max()]
    longest = np.linalg.norm(outer[:, None] - outer[None], axis=2).max()
    for folder in ("models", "models_eval"):
        info = json.loads((tmp_path / folder / "models_info.json").read_text())["1"]
        assert info["diameter"] == pytest.approx(longest, rel=1e-6)
        low = np.array([info[f"min_{axis}"] for axis in "xyz"])
        size = np.array([info[f"size_{axis}"] for axis in "xyz"])
        np.testing.assert_allclose([low, low + size], [vertices.min(axis=0), vertices.max(axis=0)], atol=1e-5)
        np.testing.assert_allclose(info["box_centre_mm"], low + size / 2)
        assert not [key for key in info if key.startswith("symmetries")]


def test_a_mesh_without_a_smaller_form_stays_whole():
    x, y = np.meshgrid(np.arange(6.0), np.arange(5.0))
    mesh = grid_mesh(x, y, 0 * x)
    assert reduced_mesh(mesh, 30) is mesh
    assert len(reduced_mesh(mesh, 29).vertices) <= 29
    # no face has two corners
    assert reduced_mesh(mesh, 2) is mesh
