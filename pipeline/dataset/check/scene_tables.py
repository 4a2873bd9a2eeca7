"""The tables of a scene, BOP's and COCO's, against the records of its views."""

import json
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

from ...errors import InputError
from ..dataset_file import Description
from ..layout import OBJECT_ID, SCENE_TABLES, ViewPaths, scene_folder
from ..run.resume_record import ViewRecord
from .comparison import read_table, require_equal, shortened
from .findings import Findings

KIND = "tables that disagree"
HIDDEN_BELOW = 0.1
"""bop_toolkit's calc_gt_coco.py marks annotations with a smaller visible fraction ``ignore``."""


def check_scene_tables(
    root: Path, scene: int, records: Mapping[int, ViewRecord], description: Description, findings: Findings
) -> None:
    """Compare the tables of a scene with the records of all its views, by number."""
    for table in SCENE_TABLES:
        name = f"{scene_folder(scene)}/{table}"
        if not (root / name).is_file():
            continue  # its sum has told
        with findings.collecting(KIND):
            found = read_table(root, name)
            if table == "scene_gt_coco.json":
                _check_coco(found, name, records, description)
            else:
                require_equal(found, _bop_table(table, root, records, description), f"{name} (see frame/)")


def _bop_table(
    table: str, root: Path, records: Mapping[int, ViewRecord], description: Description
) -> dict[str, object]:
    """One of BOP's tables."""
    content: dict[str, object] = {}
    for index, record in records.items():
        rotation, translation = record.cam_from_model[:3, :3].ravel().tolist(), record.cam_from_model[:3, 3].tolist()
        # boxes as JSON has them
        info = json.loads(json.dumps(asdict(record.gt_info)))
        entries: dict[str, object] = {
            "scene_camera.json": {
                "cam_K": description.camera.k.ravel().tolist(),
                "depth_scale": record.depth_scale,
                "cam_R_w2c": rotation,
                "cam_t_w2c": translation,
            },
            "scene_gt.json": [{"cam_R_m2c": rotation, "cam_t_m2c": translation, "obj_id": OBJECT_ID}],
            "scene_gt_info.json": [info],
        }
        content[str(ViewPaths(root, index).image_id)] = entries[table]
    return content


def _check_coco(found: Any, where: str, records: Mapping[int, ViewRecord], description: Description) -> None:
    size = {"width": description.camera.width, "height": description.camera.height}
    images, annotations = [], []
    for index, record in records.items():
        paths, info = ViewPaths(Path(), index), record.gt_info
        images.append({"id": paths.image_id, "file_name": f"rgb/{paths.file('rgb').name}", **size})
        if not info.px_count_visib:
            continue
        x, y, to_last_column, to_last_row = info.bbox_visib
        annotations.append(
            {
                "id": paths.image_id + 1,
                "image_id": paths.image_id,
                "category_id": OBJECT_ID,
                "iscrowd": 0,
                "area": info.px_count_visib,
                # COCO counts pixels, BOP the steps between them
                "bbox": [x, y, to_last_column + 1, to_last_row + 1],
                "segmentation": {"counts": list(record.rle_counts), "size": [size["height"], size["width"]]},
                **size,
                "ignore": info.visib_fract < HIDDEN_BELOW,
            }
        )
    category = {"id": OBJECT_ID, "name": description.name, "supercategory": "surface"}
    expected = {
        "info": {}, "licenses": [], "categories": [category], "images": images, "annotations": annotations,
    }  # fmt: skip
    try:
        for annotation in found["annotations"]:
            segmentation = annotation["segmentation"]
            segmentation["counts"] = _run_lengths(segmentation["counts"])
    except (KeyError, TypeError, ValueError):
        raise InputError(
            f"{where}: expected annotations with compressed run lengths, found {shortened(found)}"
        ) from None
    require_equal(found, expected, where)


def _run_lengths(text: str) -> list[int]:
    """COCO's compressed run lengths as numbers: groups of 5 bits, each run less the one before the last.

    Source: cocodataset/cocoapi, ``rleFrString`` in common/maskApi.c.
    """
    counts: list[int] = []
    value = place = 0
    for group in (ord(character) - ord("0") for character in text):
        value += (group & 31) << (5 * place)
        place += 1
        if group & 32 and place < 13:  # more groups follow; 13 have more bits than any image
            continue
        if group & 16:
            value -= 1 << (5 * place)
        counts.append(value + (counts[-2] if len(counts) > 2 else 0))
        value = place = 0
    return counts
