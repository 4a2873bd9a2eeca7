"""COCO's run lengths code the mask, and its tables refer to the images that they are about."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from pycocotools import mask as coder

from oneframe.dataset.layout import ViewPaths
from oneframe.dataset.run.resume_record import GroundTruthInfo, read_record
from oneframe.dataset.tables.bop import compressed_counts, run_lengths, write_scene
from tests.dataset.masks import masks
from tests.dataset.synthetic_dataset import CAMERA, OBJECT_NAME, SCENES, scene_tables

pytestmark = pytest.mark.usefixtures("small_scenes")


def decoded(counts: object, size: tuple[int, int]) -> np.ndarray:
    """As pycocotools reads it."""
    segmentation = {"counts": counts, "size": list(size)}
    return coder.decode(segmentation if isinstance(counts, str) else coder.frPyObjects(segmentation, *size)) > 0


@given(masks)
def test_run_lengths_are_the_shortest_code_of_the_mask_also_compressed(mask):
    runs = run_lengths(mask)
    np.testing.assert_array_equal(decoded(list(runs), mask.shape), mask)
    # only the first run may be empty: otherwise it would not be the one shortest code
    assert all(length > 0 for length in runs[1:])
    np.testing.assert_array_equal(decoded(compressed_counts(runs), mask.shape), mask)


@pytest.mark.parametrize(("scene", "views"), SCENES)
def test_coco_tables_refer_to_their_images_and_hold_their_masks(sound, scene, views):
    """Boxes count pixels."""
    coco = scene_tables(sound, scene)["scene_gt_coco_modal"]
    assert [image["id"] for image in coco["images"]] == list(range(len(views)))
    for image in coco["images"]:
        assert (sound / "train_synt" / f"{scene:06d}" / image["file_name"]).exists()
        assert (image["width"], image["height"]) == CAMERA.size_wh
    (category,) = coco["categories"]
    assert category["name"] == OBJECT_NAME
    assert [annotation["image_id"] for annotation in coco["annotations"]] == list(range(len(views)))
    assert 0 not in {annotation["id"] for annotation in coco["annotations"]}
    assert len({annotation["id"] for annotation in coco["annotations"]}) == len(views)
    for annotation, view in zip(coco["annotations"], views, strict=True):
        record = read_record(ViewPaths(sound, view))
        assert (annotation["category_id"], annotation["iscrowd"]) == (category["id"], 0)
        assert tuple(annotation["segmentation"]["size"]) == CAMERA.shape_hw
        mask = decoded(annotation["segmentation"]["counts"], CAMERA.shape_hw)
        assert run_lengths(mask) == record.rle_counts
        assert annotation["area"] == np.count_nonzero(mask)
        x, y, width, height = annotation["bbox"]
        assert mask[y : y + height, x : x + width].sum() == annotation["area"]
        box = mask[y : y + height, x : x + width]
        assert all(side.any() for side in (box[0], box[-1], box[:, 0], box[:, -1]))
        assert annotation["ignore"] == (record.gt_info.visib_fract < 0.1)


def test_a_view_without_surface_has_no_annotation(sound, tmp_path):
    """As in bop_toolkit's calc_gt_coco.py."""
    record = read_record(ViewPaths(sound, 0))
    empty = GroundTruthInfo((0, 0, 1, 1), (-1, -1, -1, -1), 80, 0, 0, 0.0)
    write_scene(tmp_path, [replace(record, gt_info=empty, rle_counts=(64 * 48,))], CAMERA, OBJECT_NAME)
    coco = scene_tables(tmp_path, 0)["scene_gt_coco_modal"]
    assert (len(coco["images"]), coco["annotations"]) == (1, [])
