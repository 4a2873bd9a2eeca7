"""The tables of a dataset against the records of its views: BOP, COCO, NeRF and CSV must agree.

The conversions here are independent (inverse matrices by elimination, axes and pixel origin as plain numbers), so that
they reveal a mistake in the code that writes the tables.
"""

import csv
import io
from collections.abc import Iterable, Mapping
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from ...camera.pinhole import PinholeCamera
from ...errors import InputError
from ...files.content import read_content
from ..layout import OBJECT_ID, ViewPaths
from .findings import Findings
from .records import DamagedFile, Identity, ViewRecord, check_rotation, mapping, numbers, read_object, shortened

SCENE_TABLES = ("scene_camera.json", "scene_gt.json", "scene_gt_info.json", "scene_gt_coco.json")
KIND = "tables that disagree"
RELATIVE = 1e-9
HIDDEN_BELOW = 0.1
"""bop_toolkit's calc_gt_coco.py marks annotations with a smaller visible fraction ``ignore``."""

Records = Mapping[int, ViewRecord]


def check_scene_tables(
    root: Path, views: range, records: Records, identity: Identity, missing: set[str], findings: Findings
) -> None:
    """Compare the four tables of the scene of ``views`` with the readable records.

    Parameters
    ----------
    root, views, identity
        The dataset's folder, the scene's views, the dataset's identity.
    records
        Records by number of the view.
    missing
        Missing files, relative to ``root``.
    findings
        Receives what is wrong.
    """
    paths = {index: ViewPaths(root, index) for index in views}
    expected: dict[str, dict] = {name: {} for name in SCENE_TABLES[:3]}
    for index, record in records.items():
        key, pose = str(paths[index].image_id), (record.rotation, record.translation)
        k = identity.camera.k.ravel().tolist()
        names = ("cam_K", "depth_scale", "cam_R_w2c", "cam_t_w2c")
        expected["scene_camera.json"][key] = dict(zip(names, (k, record.depth_scale, *pose), strict=True))
        expected["scene_gt.json"][key] = [{"cam_R_m2c": pose[0], "cam_t_m2c": pose[1], "obj_id": OBJECT_ID}]
        expected["scene_gt_info.json"][key] = [record.gt_info]
    scene = paths[views[0]].scene
    keys = {str(path.image_id) for path in paths.values()}
    by_image = {str(paths[index].image_id): record for index, record in records.items()}
    for name in SCENE_TABLES:
        where = (scene / name).relative_to(root).as_posix()
        if where in missing:
            continue
        try:
            content = read_object(scene / name, where)
            if name == "scene_gt_coco.json":
                _check_coco(content, where, {index: paths[index] for index in records}, records, identity, keys)
                continue
            _check_keys(content.keys(), keys, where)
        except DamagedFile as damage:
            findings.add(KIND, damage)
            continue
        for key, entry in expected[name].items():
            if content[key] != entry:
                findings.add(
                    KIND, f"{where}: image {key}: {_difference(content[key], entry)}, see {by_image[key].where}"
                )


def check_camera_file(root: Path, camera: PinholeCamera, finest_scale: float, findings: Findings) -> None:
    """Compare ``camera.json`` with ``dataset.json``; its depth scale is at most the finest scale of a view."""
    where = "camera.json"
    try:
        content = read_object(root / where, where)
        _check_values(
            content, {name: getattr(camera, name) for name in ("fx", "fy", "cx", "cy", "width", "height")}, where
        )
        if not 0 < numbers(content, "depth_scale", (), where) <= finest_scale:
            raise DamagedFile(f"{where}: depth_scale is {content['depth_scale']:g}, a view has {finest_scale:g}")
    except DamagedFile as damage:
        findings.add(KIND, damage)


def check_pose_table(root: Path, records: Records, identity: Identity, findings: Findings) -> None:
    """Compare ``poses.csv`` with the records: poses from the model frame and from that of the mesh file."""
    where = "poses.csv"
    try:
        rows = _read_csv(root / where, where)
        if len(rows) != identity.count:
            raise DamagedFile(f"{where}: expected {identity.count} rows, found {len(rows)}")
        model_from_mesh = np.linalg.inv(identity.mesh_from_model)
        for index, record in records.items():
            here = f"{where}: row {index}"
            if (rows[index].get("index"), rows[index].get("image")) != (
                str(index),
                ViewPaths(root, index).relative("rgb"),
            ):
                raise DamagedFile(f"{here}: expected view {index} and its image, found {shortened(rows[index])}")
            _check_pose(_row_pose(rows[index], here), record, here)
            given = _row_numbers(rows[index], [f"mesh_t{axis}_mm" for axis in "xyz"], here)
            expected = (record.cam_from_model @ model_from_mesh)[:3, 3]
            if not _close(given, expected, np.abs(model_from_mesh[:3, 3]).max()):
                raise DamagedFile(f"{here}: mesh_t is {given.tolist()}, {record.where} gives {expected.tolist()}")
    except DamagedFile as damage:
        findings.add(KIND, damage)


def check_nerf_file(root: Path, records: Records, identity: Identity, findings: Findings) -> None:
    """Compare ``transforms.json`` with the records: model_from_cam with OpenGL axes, pixel origin at the corner."""
    where, camera = "transforms.json", identity.camera
    try:
        content = read_object(root / where, where)
        _check_values(content, {"w": camera.width, "h": camera.height, "fl_x": camera.fx, "fl_y": camera.fy}, where)
        half = [np.tan(numbers(content, f"camera_angle_{axis}", (), where) / 2) for axis in "xy"]
        derived = {
            "cx": (float(numbers(content, "cx", (), where)) - 0.5, camera.cx),
            "cy": (float(numbers(content, "cy", (), where)) - 0.5, camera.cy),
            "camera_angle_x": (half[0] * camera.fx, camera.width / 2),
            "camera_angle_y": (half[1] * camera.fy, camera.height / 2),
        }
        for name, (found, expected) in derived.items():
            if not _close(found, expected, camera.width):
                raise DamagedFile(f"{where}: {name} is {content[name]!r}, which does not fit dataset.json")
        frames = content.get("frames")
        if not isinstance(frames, list) or len(frames) != identity.count:
            raise DamagedFile(f"{where}: expected {identity.count} frames, found {shortened(frames)}")
        for index, record in records.items():
            frame, paths, here = frames[index], ViewPaths(root, index), f"{where}: frame {index}"
            if not isinstance(frame, dict):
                raise DamagedFile(f"{here}: expected an object, found {shortened(frame)}")
            files = {"file_path": "rgb", "depth_file_path": "depth", "mask_path": "mask"}
            _check_values(frame, {name: paths.relative(kind) for name, kind in files.items()}, here)
            model_from_cam = numbers(frame, "transform_matrix", (4, 4), here) * [1, -1, -1, 1]
            _check_pose(np.linalg.inv(model_from_cam), record, here)
    except np.linalg.LinAlgError:
        findings.add(KIND, f"{where}: expected rigid transforms, found a singular matrix")
    except DamagedFile as damage:
        findings.add(KIND, damage)


def check_video_poses(root: Path, findings: Findings) -> int:
    """Check that all poses of ``video/poses.csv`` are rigid; return their number."""
    where = "video/poses.csv"
    try:
        rows = _read_csv(root / where, where)
        for number, row in enumerate(rows):
            check_rotation(_row_pose(row, f"{where}: row {number}")[:3, :3], f"{where}: row {number}")
    except DamagedFile as damage:
        findings.add(KIND, damage)
        return 0
    return len(rows)


def _check_coco(
    content: dict,
    where: str,
    paths: Mapping[int, ViewPaths],
    records: Records,
    identity: Identity,
    keys: set[str],
) -> None:
    camera = identity.camera
    images, annotations = (
        _by_number(content, "images", "id", where),
        _by_number(content, "annotations", "image_id", where),
    )
    _check_keys(images.keys(), keys, f"{where}: images")
    hidden = {str(paths[index].image_id) for index, record in records.items() if not record.gt_info["px_count_visib"]}
    _check_keys(annotations.keys(), keys - hidden, f"{where}: annotations")
    if len({entry.get("id") for entry in annotations.values()}) != len(annotations):
        raise DamagedFile(f"{where}: expected annotations with different ids")
    categories = _by_number(content, "categories", "id", where)
    if categories.keys() != {str(OBJECT_ID)}:
        raise DamagedFile(f"{where}: expected the one category {OBJECT_ID}, found {sorted(categories)}")
    _check_values(categories[str(OBJECT_ID)], {"name": identity.object_name}, f"{where}: category {OBJECT_ID}")
    for index, record in records.items():
        path, info = paths[index], record.gt_info
        key, size = str(path.image_id), {"width": camera.width, "height": camera.height}
        image = {"id": path.image_id, "file_name": f"rgb/{path.file('rgb').name}", **size}
        _check_values(images[key], image, f"{where}: image {key}")
        if key in hidden:
            continue
        x, y, to_last_column, to_last_row = info["bbox_visib"]
        here, found = f"{where}: annotation of image {key}", annotations[key]
        annotation = {
            "image_id": path.image_id,
            "category_id": OBJECT_ID,
            "iscrowd": 0,
            "area": info["px_count_visib"],
            "bbox": [x, y, to_last_column + 1, to_last_row + 1],
            **size,
            "ignore": info["visib_fract"] < HIDDEN_BELOW,
        }
        _check_values(found, annotation, here)
        segmentation = mapping(found, "segmentation", here)
        _check_values(segmentation, {"size": [camera.height, camera.width]}, here)
        counts = {"counts": _decoded_counts(segmentation.get("counts"), here)}
        _check_values(counts, {"counts": record.run_lengths.tolist()}, here)


def _decoded_counts(text: object, where: str) -> list[int]:
    """COCO's compressed run lengths as numbers: groups of 5 bits, each run less the one before the last."""
    if not isinstance(text, str) or not text or not all("0" <= character <= "o" for character in text):
        raise DamagedFile(f"{where}: expected compressed run lengths, found {shortened(text)}")
    counts: list[int] = []
    groups = [ord(character) - ord("0") for character in text]
    while groups:
        length = next((place for place, group in enumerate(groups, start=1) if group < 32), len(groups))
        value = sum((group % 32) * 32**place for place, group in enumerate(groups[:length]))
        if groups[length - 1] % 32 >= 16:
            value -= 32**length
        counts.append(value + (counts[-2] if len(counts) > 2 else 0))
        groups = groups[length:]
    return counts


def _by_number(content: dict, name: str, number: str, where: str) -> dict[str, dict]:
    entries = content.get(name)
    if not isinstance(entries, list) or not all(isinstance(entry, dict) for entry in entries):
        raise DamagedFile(f"{where}: expected a list of {name}, found {shortened(entries)}")
    found = {str(entry.get(number)): entry for entry in entries}
    if len(found) != len(entries):
        raise DamagedFile(f"{where}: {name}: expected different numbers {number}, found one twice")
    return found


def _check_keys(found: Iterable[str], expected: set[str], where: str) -> None:
    missing, surplus = expected - set(found), set(found) - expected
    if missing or surplus:
        problems = [
            f"{len(some)} {what} ({', '.join(sorted(some)[:3])})"
            for some, what in ((missing, "missing"), (surplus, "unexpected"))
            if some
        ]
        raise DamagedFile(f"{where}: expected an entry for each of {len(expected)} images, {' and '.join(problems)}")


def _check_values(found: Mapping, expected: Mapping, where: str) -> None:
    for name, value in expected.items():
        if found.get(name) != value:
            raise DamagedFile(f"{where}: {_difference({name: found.get(name)}, {name: value})}")


def _difference(found: object, expected: object, name: str = "the entry") -> str:
    """The first difference of two JSON values, as a clause."""
    if isinstance(found, dict) and isinstance(expected, dict):
        for key in (*expected, *found):
            if found.get(key) != expected.get(key):
                return _difference(found.get(key), expected.get(key), key)
    if isinstance(found, list) and isinstance(expected, list) and len(found) == len(expected):
        for number, pair in enumerate(zip(found, expected, strict=True)):
            if pair[0] != pair[1]:
                return _difference(*pair, f"{name}[{number}]" if len(found) > 1 else name)
    return f"{name} is {shortened(found)}, expected {shortened(expected)}"


def _check_pose(cam_from_model: np.ndarray, record: ViewRecord, where: str) -> None:
    expected, size = record.cam_from_model, np.abs(record.cam_from_model[:3, 3]).max()
    rotation_ok = _close(cam_from_model[:3, :3], expected[:3, :3], 1.0)
    if not rotation_ok or not _close(cam_from_model[:3, 3], expected[:3, 3], size):
        part = (slice(0, 3), 3) if rotation_ok else (slice(0, 3), slice(0, 3))
        name = "translation" if rotation_ok else "rotation"
        difference = np.abs(cam_from_model[part] - expected[part]).max()
        raise DamagedFile(f"{where}: the {name} differs from that of {record.where} by {difference:.2g}")


def _close(found: ArrayLike, expected: ArrayLike, size: float) -> bool:
    return bool((np.abs(np.subtract(found, expected)) <= RELATIVE * max(size, 1.0)).all())


def _read_csv(path: Path, where: str) -> list[dict]:
    try:
        text = read_content(path, "a file of the dataset", where).decode()
        return list(csv.DictReader(io.StringIO(text, newline="")))
    except InputError as error:
        raise DamagedFile(str(error)) from None
    except (csv.Error, UnicodeDecodeError) as error:
        raise DamagedFile(f"{where}: expected a CSV table, found a damaged file ({error})") from None


def _row_numbers(row: Mapping, names: list[str], where: str) -> np.ndarray:
    return numbers(
        {"columns " + ", ".join(names): [row.get(name) for name in names]},
        "columns " + ", ".join(names),
        (len(names),),
        where,
    )


def _row_pose(row: Mapping, where: str) -> np.ndarray:
    pose = np.eye(4)
    rotation = [f"r{i}{j}" for i in range(3) for j in range(3)]
    pose[:3, :3] = _row_numbers(row, rotation, where).reshape(3, 3)
    pose[:3, 3] = _row_numbers(row, ["tx_mm", "ty_mm", "tz_mm"], where)
    return pose
