"""The tables of a scene, BOP's and COCO's, against the records of its views."""

from collections.abc import Collection, Mapping
from pathlib import Path

from ..layout import OBJECT_ID, ViewPaths
from .comparison import require_entries, require_equal
from .contents import SCENE_TABLES, SceneContents
from .files import DamagedFile, mapping, read_object, require_keys, shortened
from .findings import Findings
from .records import Description, ViewRecord

KIND = "tables that disagree"
HIDDEN_BELOW = 0.1
"""bop_toolkit's calc_gt_coco.py marks annotations with a smaller visible fraction ``ignore``."""
ENTRY_BYTES = 4096
"""More than an entry of a view takes, apart from its mask."""


def check_scene_tables(
    root: Path,
    scene: SceneContents,
    records: Mapping[int, ViewRecord],
    description: Description,
    findings: Findings,
    *,
    skipped: Collection[str] = (),
) -> None:
    """Compare the tables of a scene, but the skipped ones, with the readable records of its views, by number."""
    paths = {index: ViewPaths(root, index) for index in scene.views}
    keys = {str(path.image_id) for path in paths.values()}
    folder = paths[scene.views[0]].scene.relative_to(root).as_posix()
    runs = sum(len(record.run_lengths) for record in records.values())
    most = ENTRY_BYTES * (len(records) + 1) + 16 * runs
    for name in SCENE_TABLES:
        where = f"{folder}/{name}"
        if where in scene.missing or where in skipped:
            continue
        try:
            content = read_object(root, where, most)
            if name == "scene_gt_coco.json":
                _check_coco(content, where, paths, records, description, keys)
                continue
            require_entries(content.keys(), keys, where)
        except DamagedFile as damage:
            findings.add(KIND, damage)
            continue
        for index, record in records.items():
            key = str(paths[index].image_id)
            try:
                expected = _entry(name, record, description)
                require_equal(content[key], expected, f"{where}: image {key}", record.where)
            except DamagedFile as damage:
                findings.add(KIND, damage)


def _entry(table: str, record: ViewRecord, description: Description) -> object:
    """The entry of a view in one of BOP's tables."""
    if table == "scene_camera.json":
        return {
            "cam_K": description.camera.k.ravel().tolist(),
            "depth_scale": record.depth_scale,
            "cam_R_w2c": record.rotation,
            "cam_t_w2c": record.translation,
        }
    if table == "scene_gt.json":
        return [{"cam_R_m2c": record.rotation, "cam_t_m2c": record.translation, "obj_id": OBJECT_ID}]
    return [record.gt_info]


def _check_coco(
    content: dict,
    where: str,
    paths: Mapping[int, ViewPaths],
    records: Mapping[int, ViewRecord],
    description: Description,
    keys: set[str],
) -> None:
    require_keys(content, {"info", "licenses", "categories", "images", "annotations"}, where)
    category = {"id": OBJECT_ID, "name": description.object_name, "supercategory": "surface"}
    beside = {name: content[name] for name in ("info", "licenses")}
    require_equal(beside, {"info": {}, "licenses": []}, where)
    categories = _by_number(content, "categories", "id", where)
    require_equal(categories, {str(OBJECT_ID): category}, f"{where}: categories")
    images = _by_number(content, "images", "id", where)
    annotations = _by_number(content, "annotations", "image_id", where)
    require_entries(images.keys(), keys, f"{where}: images")
    hidden = {str(paths[index].image_id) for index, record in records.items() if not record.gt_info["px_count_visib"]}
    require_entries(annotations.keys(), keys - hidden, f"{where}: annotations")
    size = {"width": description.camera.width, "height": description.camera.height}
    for index, record in records.items():
        path, info = paths[index], record.gt_info
        key = str(path.image_id)
        image = {"id": path.image_id, "file_name": f"rgb/{path.file('rgb').name}", **size}
        require_equal(images[key], image, f"{where}: image {key}")
        if key in hidden:
            continue
        here, found = f"{where}: annotation of image {key}", annotations[key]
        segmentation = mapping(found, "segmentation", here)
        found = found | {"segmentation": segmentation | {"counts": _run_lengths(segmentation.get("counts"), here)}}
        x, y, to_last_column, to_last_row = info["bbox_visib"]
        annotation = {
            "id": path.image_id + 1,
            "image_id": path.image_id,
            "category_id": OBJECT_ID,
            "iscrowd": 0,
            "area": info["px_count_visib"],
            # COCO counts pixels, BOP the steps between them
            "bbox": [x, y, to_last_column + 1, to_last_row + 1],
            "segmentation": {"counts": record.run_lengths.tolist(), "size": [size["height"], size["width"]]},
            **size,
            "ignore": info["visib_fract"] < HIDDEN_BELOW,
        }
        require_equal(found, annotation, here)


def _by_number(content: dict, name: str, number: str, where: str) -> dict[str, dict]:
    entries = content.get(name)
    if not isinstance(entries, list) or not all(isinstance(entry, dict) for entry in entries):
        raise DamagedFile(f"{where}: expected a list of {name}, found {shortened(entries)}")
    found = {str(entry.get(number)): entry for entry in entries}
    if len(found) != len(entries):
        raise DamagedFile(f"{where}: {name}: expected different numbers {number}, found one twice")
    return found


def _run_lengths(text: object, where: str) -> list[int]:
    """COCO's compressed run lengths as numbers: groups of 5 bits, each run less the one before the last.

    Source: cocodataset/cocoapi, ``rleFrString`` in common/maskApi.c.
    """
    if not isinstance(text, str) or not text or not all("0" <= character <= "o" for character in text):
        raise DamagedFile(f"{where}: expected compressed run lengths, found {shortened(text)}")
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
