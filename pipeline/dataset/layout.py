"""A dataset's views on disk, in the BOP layout: the path of each file.

A view is finished when its record ``frame/NNNNNN.json`` exists. The record is written last and holds the hashes of the
view's other files. All tables of the dataset (:mod:`pipeline.dataset.bop`, :mod:`pipeline.dataset.coco`,
:mod:`pipeline.dataset.pose_tables`) are made from the records alone.
"""

from dataclasses import dataclass
from pathlib import Path

FORMAT = "oneframe dataset 2"
"""Name and version of the layout, in ``dataset.json``."""

SPLIT = "train_synt"
"""BOP's name for rendered images to train on. Its toolkit expects PNG files in it, and JPEG files in ``train_pbr``."""
VIEWS_PER_SCENE = 1000
OBJECT_ID = 1


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
        return self.root / SPLIT / f"{self.scene_id:06d}"

    def file(self, kind: str) -> Path:
        """Path of one of the view's files, by its kind (a key of :func:`.view_files`, or ``"frame"``)."""
        gt = "_000000" if kind in ("mask", "mask_visib", "mask_observed") else ""
        suffix = {"frame": ".json", "depth_mm": ".npy"}.get(kind, ".png")
        return self.scene / kind / f"{self.image_id:06d}{gt}{suffix}"

    def relative(self, kind: str) -> str:
        """Path of one of the view's files relative to the dataset's folder, with forward slashes."""
        return self.file(kind).relative_to(self.root).as_posix()


def finished_views(root: Path, views: range) -> set[int]:
    """Which of these views have a record; an empty file, which a loss of power may leave, does not count."""
    return {index for index in views if _has_content(ViewPaths(root, index).file("frame"))}


def _has_content(path: Path) -> bool:
    try:
        return path.stat().st_size > 0
    except FileNotFoundError:
        return False
