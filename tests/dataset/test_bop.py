"""BOP's files hold what its readers expect, and boxes are those counted pixel by pixel."""

import json

import numpy as np
import pytest
from hypothesis import given, settings

from pipeline.dataset.bop import bounding_box, write_models
from pipeline.surface.mesh import TriangleMesh
from pipeline.surface.mesh_reader import read_mesh
from tests.dataset.blank_dataset import pose_of, scene_tables
from tests.dataset.masks import masks


@settings(deadline=None)
@given(masks)
def test_boxes_are_those_counted_pixel_by_pixel(mask):
    pixels = [(int(x), int(y)) for y, x in np.argwhere(mask)]
    if pixels:
        left, top = (min(pixel[axis] for pixel in pixels) for axis in (0, 1))
        right, bottom = (max(pixel[axis] for pixel in pixels) for axis in (0, 1))
        assert bounding_box(mask) == (left, top, right - left, bottom - top)
    else:
        assert bounding_box(mask) == (-1, -1, -1, -1)


@pytest.mark.parametrize(("scene", "views"), [(0, [0, 1, 2]), (1, [3, 4])])
def test_scene_tables_have_the_entries_of_bop(written, scene, views):
    """Names and nesting of bop_toolkit's docs/bop_datasets_format.md and inout.load_scene_gt/camera."""
    tables = scene_tables(written, scene)
    assert tables.keys() == {"scene_camera", "scene_gt", "scene_gt_info", "scene_gt_coco"}
    for name in ("scene_camera", "scene_gt", "scene_gt_info"):
        assert list(tables[name]) == [str(image) for image in range(len(views))]
    for image, view in enumerate(views):
        pose, (truth,), (info,) = pose_of(view), tables["scene_gt"][str(image)], tables["scene_gt_info"][str(image)]
        assert truth.keys() == {"cam_R_m2c", "cam_t_m2c", "obj_id"}
        np.testing.assert_array_equal(np.reshape(truth["cam_R_m2c"], (3, 3)), pose[:3, :3])
        np.testing.assert_array_equal(truth["cam_t_m2c"], pose[:3, 3])
        camera = tables["scene_camera"][str(image)]
        assert camera.keys() == {"cam_K", "depth_scale", "cam_R_w2c", "cam_t_w2c"}
        assert camera["cam_K"] == [31.7, 0, 8.2, 0, 29.3, 7.9, 0, 0, 1]
        counts = {"px_count_all", "px_count_valid", "px_count_visib"}
        assert info.keys() == {"bbox_obj", "bbox_visib", "visib_fract", *counts}


def test_model_and_camera_files(tmp_path, written):
    rng = np.random.default_rng(4)
    vertices = rng.normal(scale=20, size=(40, 3))
    mesh = TriangleMesh(vertices, rng.permuted(np.tile(np.arange(40), (60, 1)), axis=1)[:, :3].astype(np.int32))
    write_models(tmp_path, mesh, rng.integers(0, 256, (40, 3)).astype(np.uint8))
    read, _ = read_mesh(tmp_path / "models" / "obj_000001.ply")
    np.testing.assert_allclose(read.vertices, vertices, rtol=1e-6)
    np.testing.assert_array_equal(read.faces, mesh.faces)
    info = json.loads((tmp_path / "models" / "models_info.json").read_text())["1"]
    distances = np.linalg.norm(vertices[:, None] - vertices[None], axis=2)
    assert info["diameter"] == pytest.approx(distances.max())
    for axis, name in enumerate("xyz"):
        assert info[f"min_{name}"] == vertices[:, axis].min()
        assert info[f"size_{name}"] == pytest.approx(np.ptp(vertices[:, axis]))
    camera = json.loads((written / "camera.json").read_text())
    assert camera == {"fx": 31.7, "fy": 29.3, "cx": 8.2, "cy": 7.9, "width": 20, "height": 14, "depth_scale": 0.002}
