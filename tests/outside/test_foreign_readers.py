"""Datasets in the eyes of readers that others wrote: pycocotools, and the rules of BOP's toolkit."""

import contextlib
import io
import json
from pathlib import Path

import cv2
import numpy as np
import pytest
from pycocotools import mask as coder
from pycocotools.coco import COCO
from pycocotools.cocoeval import COCOeval

from oneframe.camera.pinhole import PinholeCamera
from oneframe.surface.mesh_reader import read_mesh
from oneframe.transforms import rigid
from tests.conftest import intersect
from tests.outside.foreign_datasets import scenes

DELTA_MM = 15.0
"""Tolerance of the toolkit's test for visibility."""


# --- COCO


def evaluated(truth, detections: list[dict], kind: str) -> float:
    """The average precision over IoU 0.5 to 0.95 that pycocotools reports."""
    with contextlib.redirect_stdout(io.StringIO()):
        evaluation = COCOeval(truth, truth.loadRes(detections), kind)
        evaluation.evaluate()
        evaluation.accumulate()
        evaluation.summarize()
    return float(evaluation.stats[0])


def detections(scene: Path, *, shift_px: int = 0) -> list[dict]:
    """What a perfect detector makes of the mask images; off by so many pixels."""
    found = []
    for path in sorted((scene / "mask_visib").glob("*.png")):
        mask = np.roll(cv2.imread(str(path), cv2.IMREAD_UNCHANGED) > 0, shift_px, axis=1)
        if mask.any():
            code = coder.encode(np.asfortranarray(mask.astype(np.uint8)))
            entry = {"image_id": int(path.stem.split("_")[0]), "category_id": 1, "score": 0.9}
            found.append(entry | {"bbox": coder.toBbox(code).tolist(), "segmentation": code})
    return found


def test_a_perfect_detector_scores_one_by_pycocotools(dataset):
    for _, scene in scenes(dataset):
        with contextlib.redirect_stdout(io.StringIO()):
            truth = COCO(str(scene / "scene_gt_coco_modal.json"))
        (category,) = truth.loadCats(truth.getCatIds())
        assert category["name"] == json.loads((dataset / "dataset.json").read_text())["object"]
        for image in truth.loadImgs(truth.getImgIds()):
            assert cv2.imread(str(scene / image["file_name"])).shape[:2] == (image["height"], image["width"])
            path = scene / "mask_visib" / f"{image['id']:06d}_000000.png"
            mask = cv2.imread(str(path), cv2.IMREAD_UNCHANGED) > 0
            annotations = truth.loadAnns(truth.getAnnIds(imgIds=image["id"]))
            assert len(annotations) == mask.any()
            for annotation in annotations:
                np.testing.assert_array_equal(truth.annToMask(annotation) > 0, mask)
                assert annotation["area"] == np.count_nonzero(mask)
        itself = [{**annotation, "score": 1.0} for annotation in truth.dataset["annotations"]]
        for kind in ("bbox", "segm"):
            assert evaluated(truth, detections(scene), kind) == pytest.approx(1)
            assert evaluated(truth, itself, kind) == pytest.approx(1)
            assert evaluated(truth, detections(scene, shift_px=3), kind) < 0.9


# --- BOP: the toolkit's rules in short


def depth_of_model(dataset: Path, k: np.ndarray, pose: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    """``(3 H, 3 W)`` depth of ``models/`` on the toolkit's canvas, cast ray by ray without a renderer."""
    width, height = (3 * side for side in size)
    wide = PinholeCamera(width, height, k[0, 0], k[1, 1], k[0, 2] + size[0], k[1, 2] + size[1])
    v, u = np.mgrid[:height, :width]
    mesh, _ = read_mesh(dataset / "models" / "obj_000001.ply")
    depth, _ = intersect(mesh, wide, pose, np.stack([u, v], -1).reshape(-1, 2).astype(float))
    return depth.reshape(height, width)


def box_of(mask: np.ndarray, offset: tuple[int, int] = (0, 0)) -> list[int]:
    """The toolkit's ``calc_2d_bbox``."""
    if not mask.any():
        return [-1, -1, -1, -1]
    ys, xs = mask.nonzero()
    return [int(xs.min()) - offset[0], int(ys.min()) - offset[1], int(np.ptp(xs)), int(np.ptp(ys))]


def as_the_toolkit_counts(dataset: Path, scene: Path, image: str) -> tuple[dict, dict]:
    """An entry of ``scene_gt_info.json`` as in the toolkit's calc_gt_info.py, and ours."""
    camera, (truth,), (info,) = (
        json.loads((scene / f"scene_{name}.json").read_text())[image] for name in ("camera", "gt", "gt_info")
    )
    path = scene / "depth" / f"{int(image):06d}.png"
    depth = cv2.imread(str(path), cv2.IMREAD_UNCHANGED).astype(np.float32) * np.float32(camera["depth_scale"])
    height, width = depth.shape
    k = np.reshape(camera["cam_K"], (3, 3))
    pose = rigid(np.reshape(truth["cam_R_m2c"], (3, 3)), truth["cam_t_m2c"])
    wide = depth_of_model(dataset, k, pose, (width, height))
    inside = wide[height : 2 * height, width : 2 * width]
    v, u = np.mgrid[:height, :width]
    length = np.linalg.norm(np.stack([(u - k[0, 2]) / k[0, 0], (v - k[1, 2]) / k[1, 1], np.ones(u.shape)]), axis=0)
    visible = ((inside - depth) * length <= DELTA_MM) & (inside > 0) | (depth == 0) & (inside > 0)
    visib, whole = int(visible.sum()), int((wide > 0).sum())
    computed = {
        "px_count_all": whole,
        "px_count_valid": int((depth[inside > 0] > 0).sum()),
        "px_count_visib": visib,
        "visib_fract": visib / whole if whole else 0.0,
        "bbox_obj": box_of(wide > 0, (width, height)) if visib else [-1, -1, -1, -1],
        "bbox_visib": box_of(visible),
    }
    return computed, info


def assert_same_info(computed: dict, info: dict) -> None:
    """Equal up to the pixels whose centre lies on an edge."""
    assert computed.keys() == info.keys()
    for key, value in computed.items():
        tolerance = 0.005 if key == "visib_fract" else 1 if key.startswith("bbox") else 2
        assert np.abs(np.subtract(info[key], value)).max() <= tolerance, (key, info[key], value)


def test_pictures_lie_where_the_toolkit_looks_and_its_counts_are_ours(dataset):
    """``get_split_params(path, name, "train", "synt")``: PNG unless the type is pbr; ids from 0 as in the tables."""
    for scene_id, scene in scenes(dataset):
        assert scene == dataset / f"train_synt/{scene_id:06d}"
        for image in json.loads((scene / "scene_gt.json").read_text()):
            assert all((scene / kind / f"{int(image):06d}.png").is_file() for kind in ("rgb", "depth"))
            assert all((scene / kind / f"{int(image):06d}_000000.png").is_file() for kind in ("mask", "mask_visib"))
            computed, info = as_the_toolkit_counts(dataset, scene, image)
            assert_same_info(computed, info)


def test_targets_are_the_images_that_the_toolkit_would_choose(dataset):
    """As its enumerate_test_targets.py."""
    expected = [
        {"scene_id": scene_id, "im_id": int(image), "obj_id": 1, "inst_count": 1}
        for scene_id, scene in scenes(dataset)
        for image, (info,) in json.loads((scene / "scene_gt_info.json").read_text()).items()
        if info["visib_fract"] >= 0.1
    ]
    assert json.loads((dataset / "test_targets_bop19.json").read_text()) == expected
    assert expected
