"""COCO's annotations of one scene: ``scene_gt_coco.json``, as bop_toolkit's calc_gt_coco.py writes it.

Source: cocodataset.org, "Data format"; thodan/bop_toolkit, docs/bop_datasets_format.md.
"""

from collections.abc import Sequence

import numpy as np

from ...camera.pinhole import PinholeCamera
from ..layout import OBJECT_ID, ViewPaths
from ..run.resume_record import ViewRecord

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


def compressed_counts(counts: Sequence[int]) -> str:
    """Run lengths as COCO's compressed text, the only form that ``COCO.loadRes`` takes.

    Every number is the difference to the run before the last one, in groups of 5 bits, the lowest first, with a sixth
    bit if more follow. Source: cocodataset/cocoapi, ``rleToString`` in common/maskApi.c.
    """
    values = np.array(counts, np.int64)
    values[3:] -= values[1:-2].copy()
    # bits of the absolute value, of -v - 1 for a negative one, and one of sign
    size = values ^ (values >> 63)
    shifts = 5 * np.arange(max(1, -(-(int(np.max(size, initial=0)).bit_length() + 1) // 5)))
    groups = (values[:, None] >> shifts) & 31
    # a group is needed if what is left before it is more than the sign of the group below
    needed = np.concatenate([np.ones((len(values), 1), bool), size[:, None] >> (shifts[1:] - 1) > 0], axis=1)
    more = np.concatenate([needed[:, 1:], np.zeros((len(values), 1), bool)], axis=1)
    return (48 + (groups | 32 * more))[needed].astype(np.uint8).tobytes().decode()


def coco_table(
    paths: Sequence[ViewPaths], records: Sequence[ViewRecord], camera: PinholeCamera, object_name: str
) -> dict[str, object]:
    """The images, annotations and single category of a scene's views.

    As in bop_toolkit, paths are relative to the scene's folder, boxes and areas are those of the visible mask, and a
    view without visible surface has no annotation.
    """
    images, annotations = [], []
    for path, record in zip(paths, records, strict=True):
        size = {"width": camera.width, "height": camera.height}
        name = path.file("rgb").relative_to(path.scene).as_posix()
        images.append({"id": path.image_id, "file_name": name, **size})
        info = record.gt_info
        if not info.px_count_visib:
            continue
        x, y, to_last_column, to_last_row = info.bbox_visib
        annotations.append(
            {
                # pycocotools takes 0 for "no match"
                "id": path.image_id + 1,
                "image_id": path.image_id,
                "category_id": OBJECT_ID,
                "iscrowd": 0,
                "area": info.px_count_visib,
                # COCO counts pixels, BOP the steps between them
                "bbox": [x, y, to_last_column + 1, to_last_row + 1],
                "segmentation": {
                    "counts": compressed_counts(record.rle_counts),
                    "size": [camera.height, camera.width],
                },
                **size,
                "ignore": info.visib_fract < HIDDEN_BELOW,
            }
        )
    category = {"id": OBJECT_ID, "name": object_name, "supercategory": "surface"}
    return {"info": {}, "licenses": [], "categories": [category], "images": images, "annotations": annotations}
