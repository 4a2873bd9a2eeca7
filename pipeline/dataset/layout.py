"""A dataset's views on disk, in the BOP layout: the path of each file.

A view is finished when its record ``frame/NNNNNN.json`` exists. The record is written last and holds the hashes of the
view's other files. All tables of the dataset (:mod:`oneframe.dataset.tables.bop` and
:mod:`oneframe.dataset.tables.pose_tables`) are made from the records alone.
"""

import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..errors import InputError
from ..files.content import LARGEST_INPUT, LARGEST_TEXT
from .stereo import RIGHT
from .truths import TRUTHS

FORMAT = "oneframe dataset 2"
"""Name and version of the layout, in ``dataset.json``."""

SPLIT = "train_synt"
"""BOP's name for rendered images to train on. Its toolkit expects PNG files in it, and JPEG files in ``train_pbr``."""
VIEWS_PER_SCENE = 1000
MOST_VIEWS = 10_000_000
"""Of a dataset."""
OBJECT_ID = 1

RECORD, CHECKSUMS, WORK = "dataset.json", "checksums.json", ".work"
MANIFEST = "pack.json"
"""Of a pack, which has a :data:`RECORD`, too."""
MODEL_FOLDERS = ("models", "models_eval")
MODEL_FILES = tuple(
    f"{folder}/{name}" for folder in MODEL_FOLDERS for name in (f"obj_{OBJECT_ID:06d}.ply", "models_info.json")
)
TARGETS = "test_targets_bop19.json"
"""The views that BOP tests with."""
CASES = "cases"
"""Of a queue: the folder of its datasets."""
CONTACT_SHEET = "contact_sheet.png"
TABLES = (
    "camera.json", *MODEL_FILES, "poses.csv", "transforms.json", TARGETS, "dataset_info.md",
    "overlay.png", CONTACT_SHEET,
)  # fmt: skip
SCENE_TABLES = ("scene_camera.json", "scene_gt.json", "scene_gt_info.json", "scene_gt_coco_modal.json")
VIDEO_FILES = ("video/trajectory.mp4", "video/poses.csv")
FOLDERS = (*MODEL_FOLDERS, "video", SPLIT)
"""The folders beside ``dataset.json`` that a run writes into, apart from :data:`WORK`."""
KINDS = (*TRUTHS, "frame")
"""Kinds of a view's files, each in a folder of its own: its arrays and its record."""


def evenly_spaced(count: int, most: int) -> list[int]:
    """Numbers of ``most`` evenly spaced ones of ``count`` views; all if ``most`` is 0 or too large."""
    if not 0 < most < count:
        return list(range(count))
    return sorted(set(np.linspace(0, count - 1, most).round().astype(int).tolist()))


def datasets_in(folder: Path) -> list[Path]:
    """The folder of a dataset or a pack, and the one within it of the same views by another camera, if there is one."""
    further = folder / RIGHT
    # a pack that is not finished has no record yet
    return [folder, *([further] if any((further / name).exists() for name in (RECORD, WORK)) else [])]


@dataclass(frozen=True)
class ViewPaths:
    """The files of view ``index`` of a dataset in ``root``; each view has one object (ground truth 0)."""

    root: Path
    index: int

    @property
    def scene_id(self) -> int:
        """Number of the BOP scene; a scene has :data:`VIEWS_PER_SCENE` views."""
        return self.index // VIEWS_PER_SCENE

    @property
    def image_id(self) -> int:
        """Number of the view within its scene."""
        return self.index % VIEWS_PER_SCENE

    @property
    def scene(self) -> Path:
        """Folder of the scene."""
        return self.root / scene_folder(self.scene_id)

    def file(self, kind: str) -> Path:
        """Path of one of the view's files, by its kind, one of :data:`KINDS`."""
        return self.root / self.relative(kind)

    def relative(self, kind: str) -> str:
        """Path of one of the view's files relative to the dataset's folder, with forward slashes."""
        # called for every file of every view of a survey
        scene, image = divmod(self.index, VIEWS_PER_SCENE)
        return f"{scene_folder(scene)}/{kind}/{image:06d}{_ENDINGS[kind]}"


_ENDINGS = {name: truth.form.ending for name, truth in TRUTHS.items()} | {"frame": ".json"}
"""Ends of the names of files, by kind."""


_LARGEST_PIXEL = max(np.dtype(truth.form.dtype).itemsize * truth.form.channels for truth in TRUTHS.values())
"""Bytes of a pixel in the array that has most."""


def largest_view_file(width: int, height: int) -> int:
    """No file of a view of this size has more bytes: at worst all of its pixels', and a header."""
    return min(_LARGEST_PIXEL * width * height, LARGEST_INPUT) + LARGEST_TEXT


def scene_count(count: int) -> int:
    """Number of scenes of a dataset of ``count`` views."""
    return -(-count // VIEWS_PER_SCENE)


def scene_views(number: int, count: int) -> range:
    """The views of a scene of a dataset of ``count`` views."""
    return range(number * VIEWS_PER_SCENE, min((number + 1) * VIEWS_PER_SCENE, count))


def scene_folder(number: int) -> str:
    """Path of a scene's folder relative to the dataset's folder, with forward slashes."""
    return f"{SPLIT}/{number:06d}"


def other_files(count: int) -> list[str]:
    """The files of a dataset of ``count`` views that are no view's, relative to its folder.

    Its video and ``checksums.json`` are not among them.
    """
    scenes = map(scene_folder, range(scene_count(count)))
    return [RECORD, *TABLES, *(f"{scene}/{name}" for scene in scenes for name in SCENE_TABLES)]


def is_own_file(name: str) -> bool:
    """Whether a run writes a file of this name, relative to the dataset's folder, with forward slashes."""
    if name in (RECORD, CHECKSUMS, *TABLES, *VIDEO_FILES):
        return True
    in_scene = re.fullmatch(rf"{SPLIT}/[0-9]{{6,}}/(.+)", name)
    if in_scene is None:
        return False
    kind, _, file = in_scene[1].partition("/")
    return in_scene[1] in SCENE_TABLES or (
        kind in KINDS and re.fullmatch(f"[0-9]{{6}}{re.escape(_ENDINGS[kind])}", file) is not None
    )


def own_folders(root: Path) -> Iterator[tuple[str, Path]]:
    """The existing folders that a run writes into: the beginning of their files' names, and their path."""
    yield "", root
    for name in FOLDERS:
        if (root / name).is_dir():
            yield f"{name}/", root / name
    for scene in sorted((root / SPLIT).glob("[0-9]*")):
        yield f"{SPLIT}/{scene.name}/", scene
        for kind in KINDS:
            if (scene / kind).is_dir():
                yield f"{SPLIT}/{scene.name}/{kind}/", scene / kind


def check_is_dataset(folder: Path, *, has_views: bool = False) -> None:
    """Raise InputError if a folder holds a pack, or no dataset: no :data:`RECORD`, and no views either."""
    if (folder / MANIFEST).is_file():
        raise InputError(
            f"{folder}: expected the folder of a dataset, found that of a pack ({MANIFEST}); give the dataset that was "
            f"packed, or check the pack: oneframe pack --out {folder} --verify"
        )
    if not has_views and not (folder / RECORD).is_file():
        raise InputError(
            f"{folder}: expected the folder of a dataset, found no {RECORD} in it; {advice_without_record(folder)}"
        )


def advice_without_record(folder: Path) -> str:
    """What to do about a folder that holds no :data:`RECORD`: datasets of a queue have theirs."""
    for queue in (folder, folder.parent):
        if (queue / CASES).is_dir():
            return f"give one of the datasets of this queue, {queue / CASES}/NAME"
    return "give the folder that --out of oneframe render named"
