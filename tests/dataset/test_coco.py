"""COCO's run lengths code the mask, and its tables refer to the images that they are about."""

import json

import numpy as np
import pytest
from hypothesis import given

from oneframe.dataset.tables.coco import compressed_counts, run_lengths
from tests.dataset.blank_dataset import CAMERA, OBJECT_NAME, record_of, scene_tables
from tests.dataset.masks import coco_mask, masks


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


@given(masks)
def test_compressed_counts_are_decoded_to_the_mask(mask):
    text = compressed_counts(run_lengths(mask))
    np.testing.assert_array_equal(coco_mask({"counts": text, "size": mask.shape}), mask)
    assert json.loads(json.dumps(text)) == text


@pytest.mark.parametrize(("scene", "views"), [(0, [0, 1, 2]), (1, [3, 4])])
def test_coco_tables_refer_to_their_images_and_hold_their_masks(written, scene, views):
    """Boxes count pixels, and as in bop_toolkit's calc_gt_coco.py a view without surface has no annotation."""
    coco = scene_tables(written, scene)["scene_gt_coco"]
    assert [image["id"] for image in coco["images"]] == list(range(len(views)))
    for image in coco["images"]:
        assert (written / "train_synt" / f"{scene:06d}" / image["file_name"]).exists()
        assert (image["width"], image["height"]) == CAMERA.size_wh
    (category,) = coco["categories"]
    assert category["name"] == OBJECT_NAME
    shown = {image: record_of(view) for image, view in enumerate(views) if record_of(view).gt_info.px_count_visib}
    assert [annotation["image_id"] for annotation in coco["annotations"]] == list(shown)
    assert 0 not in {annotation["id"] for annotation in coco["annotations"]}
    assert len({annotation["id"] for annotation in coco["annotations"]}) == len(shown)
    for annotation in coco["annotations"]:
        record = shown[annotation["image_id"]]
        assert (annotation["category_id"], annotation["iscrowd"]) == (category["id"], 0)
        mask = coco_mask(annotation["segmentation"])
        assert mask.shape == CAMERA.shape_hw
        assert run_lengths(mask) == record.rle_counts
        assert annotation["area"] == np.count_nonzero(mask)
        x, y, width, height = annotation["bbox"]
        assert mask[y : y + height, x : x + width].sum() == annotation["area"]
        box = mask[y : y + height, x : x + width]
        assert box[0].any()
        assert box[-1].any()
        assert box[:, 0].any()
        assert box[:, -1].any()
        assert annotation["ignore"] == (record.gt_info.visib_fract < 0.1)
