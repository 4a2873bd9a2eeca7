"""COCO's annotations of one scene: ``scene_gt_coco.json``, as bop_toolkit's calc_gt_coco.py writes it.

Source: cocodataset.org, "Data format"; thodan/bop_toolkit, docs/bop_datasets_format.md.
"""

from collections.abc import Sequence

import numpy as np

from ..camera.pinhole import PinholeCamera
from .layout import OBJECT_ID, ViewPaths
from .view_record import ViewRecord

HIDDEN_BELOW = 0.1
"""Annotations with a smaller visible fraction are marked ``ignore``, as bop_toolkit does."""


def run_lengths(mask: np.ndarray) -> tuple[int, ...]:
    """The uncompressed run-length encoding of an ``(H, W)`` bool mask: column by column, zeros first."""
    flat = np.concatenate([[False], mask.T.ravel(), [False]])
    edges = np.flatnonzero(flat[1:] != flat[:-1])
    counts = np.diff(np.concatenate([[0], edges, [mask.size]]))
    if len(counts) > 1 and counts[-1] == 0:
        counts = counts[:-1]
    return tuple(counts.tolist())


def coco_table(paths: Sequence[ViewPaths], records: Sequence[ViewRecord], camera: PinholeCamera) -> dict[str, object]:
    """The images, annotations and single category of a scene's views; ids of annotations count from 1."""
    images, annotations = [], []
    for number, (path, record) in enumerate(zip(paths, records, strict=True), start=1):
        images.append(
            {
                "id": path.image_id,
                "file_name": path.file("rgb").relative_to(path.scene).as_posix(),
                "width": camera.width,
                "height": camera.height,
            }
        )
        annotations.append(
            {
                "id": number,
                "image_id": path.image_id,
                "category_id": OBJECT_ID,
                "iscrowd": 0,
                "area": record.gt_info.px_count_visib,
                "bbox": list(record.gt_info.bbox_obj),
                "segmentation": {"counts": list(record.rle_counts), "size": [camera.height, camera.width]},
                "width": camera.width,
                "height": camera.height,
                "ignore": record.gt_info.visib_fract < HIDDEN_BELOW,
            }
        )
    category = {"id": OBJECT_ID, "name": str(OBJECT_ID), "supercategory": "surface"}
    return {"info": {}, "licenses": [], "categories": [category], "images": images, "annotations": annotations}
