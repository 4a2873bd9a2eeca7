"""COCO's run lengths code the mask, and its tables refer to the images that they are about."""

import json

import numpy as np
import pytest
from hypothesis import given, settings

from pipeline.dataset.coco import run_lengths
from tests.dataset.blank_dataset import CAMERA, scene_tables
from tests.dataset.masks import masks


@settings(deadline=None)
@given(masks)
def test_run_lengths_are_the_shortest_code_of_the_mask(mask):
    """Uncompressed: down the columns, zeros first, then ones and zeros in turn."""
    found = run_lengths(mask)
    column_major, value = [], 0
    for length in found:
        column_major += [value] * length
        value = 1 - value
    height, width = mask.shape
    assert len(column_major) == mask.size
    assert all(mask[y, x] == column_major[x * height + y] for y in range(height) for x in range(width))
    # only the first run may be empty: otherwise it would not be the one shortest code
    assert all(length > 0 for length in found[1:])
    assert json.loads(json.dumps(found)) == list(found)
    assert sum(found[1::2]) == np.count_nonzero(mask)


@pytest.mark.parametrize(("scene", "views"), [(0, 3), (1, 2)])
def test_coco_tables_refer_to_their_images_and_hold_their_masks(written, scene, views):
    tables = scene_tables(written, scene)
    coco = tables["scene_gt_coco"]
    assert [image["id"] for image in coco["images"]] == list(range(views))
    assert len({annotation["id"] for annotation in coco["annotations"]}) == views
    for image, annotation in zip(coco["images"], coco["annotations"], strict=True):
        assert (written / "train_pbr" / f"{scene:06d}" / image["file_name"]).exists()
        assert (image["width"], image["height"]) == CAMERA.size_wh
        assert annotation["image_id"] == image["id"]
        assert annotation["category_id"] == coco["categories"][0]["id"]
        runs, (info,) = annotation["segmentation"], tables["scene_gt_info"][str(image["id"])]
        assert runs["size"] == [CAMERA.height, CAMERA.width]
        assert sum(runs["counts"][1::2]) == annotation["area"] == info["px_count_visib"]
        assert annotation["bbox"] == info["bbox_obj"]
        # bop_toolkit's calc_gt_coco.py
        assert annotation["ignore"] == (info["visib_fract"] < 0.1)
