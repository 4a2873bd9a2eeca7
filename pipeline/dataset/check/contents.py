"""What is in a dataset's folder and what should be: missing views and files, and those that do not belong there.

Only folders that a dataset has are listed, each once. So links that lead in circles or elsewhere cost nothing, and the
cost is that of the files that exist, whatever number of views ``dataset.json`` announces.
"""

import os
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path, PurePosixPath

from ..layout import RECORD, SPLIT, WORK, ViewPaths, scene_count, scene_folder, scene_views
from .findings import Findings
from .model import MODEL, MODELS_INFO, REDUCED, REDUCED_INFO

CHECKSUMS = "checksums.json"
VIDEO, VIDEO_POSES = "video/trajectory.mp4", "video/poses.csv"
TABLES = (
    RECORD, "camera.json", "poses.csv", "transforms.json", "test_targets_bop19.json", "dataset_info.md",
    "contact_sheet.png", "overlay.png", MODEL, MODELS_INFO, REDUCED, REDUCED_INFO,
)  # fmt: skip
SCENE_TABLES = ("scene_camera.json", "scene_gt.json", "scene_gt_info.json", "scene_gt_coco.json")
DESKTOP_FILES = {".DS_Store", "Thumbs.db", "desktop.ini"}
NOTES = {"", ".md", ".txt"}
"""Suffixes of files beside ``dataset.json`` that no reader takes for data: LICENSE, README.md, notes.txt."""
PARTIAL = ".partial-"


@dataclass(frozen=True)
class Contents:
    """A dataset's folder, without the insides of its scenes.

    Attributes
    ----------
    tables
        Every file that should be there beside those of views, relative to the dataset; without ``checksums.json``.
    missing
        Those outside the scenes that are missing, and ``checksums.json`` if it is.
    scenes
        Numbers of the scenes that have a folder.
    recorded
        Number of views that have a record.
    unfinished
        Whether a run is still going on or was stopped.
    """

    tables: frozenset[str]
    missing: frozenset[str]
    scenes: tuple[int, ...]
    recorded: int
    unfinished: bool


@dataclass(frozen=True)
class SceneContents:
    """The folder of a scene.

    Attributes
    ----------
    views
        Numbers of the views that the scene should have.
    recorded
        Those that have a record.
    absent
        Those of which no file exists.
    missing
        Missing files of the others and missing tables, relative to the dataset.
    """

    views: range
    recorded: list[int]
    absent: list[int]
    missing: frozenset[str]


def list_dataset(root: Path, count: int, findings: Findings) -> Contents:
    """List the folders of a dataset of ``count`` views outside its scenes; report what is missing or not its own."""
    unfinished = os.path.lexists(root / WORK)
    video = {VIDEO, VIDEO_POSES} if os.path.lexists(root / "video") else set()
    expected = {CHECKSUMS, *TABLES, *video}
    numbers = range(scene_count(count))
    folders: dict[str, set[str]] = {
        "models": set(),
        "models_eval": set(),
        SPLIT: {scene_folder(number) for number in numbers},
    }
    folders |= {"video": set()} if video else {}
    stray = _Stray(findings, f"a dataset of {count} views", unfinished)
    files, found = _listed(root, "", findings)
    # a run keeps its own files there
    stray.report(files - expected, found - folders.keys() - {WORK}, notes=True)
    scenes: set[str] = set()
    for folder in folders.keys() & found:
        inside, subfolders = _listed(root, folder, findings)
        stray.report(inside - expected, subfolders - folders[folder])
        files |= inside
        scenes |= subfolders & folders[folder]
    missing = expected - files
    if not unfinished:
        _report_missing(missing, findings)
    present = tuple(number for number in numbers if scene_folder(number) in scenes)
    recorded = sum(len(_recorded(root, number, count)) for number in present)
    in_scenes = (f"{scene_folder(number)}/{name}" for number in numbers for name in SCENE_TABLES)
    return Contents(frozenset({*TABLES, *video, *in_scenes}), frozenset(missing), present, recorded, unfinished)


def list_scene(
    root: Path, number: int, count: int, kinds: tuple[str, ...], findings: Findings, *, unfinished: bool
) -> SceneContents:
    """List the folder of a scene of views with files of these kinds, and report what is missing or not its own."""
    scene, views = scene_folder(number), scene_views(number, count)
    tables = {f"{scene}/{name}" for name in SCENE_TABLES}
    folders = {f"{scene}/{kind}" for kind in (*kinds, "frame")}
    stray = _Stray(findings, f"a dataset of {count} views", unfinished)
    files, found = _listed(root, scene, findings)
    stray.report(files - tables, found - folders)
    for folder in folders & found:
        inside, subfolders = _listed(root, folder, findings)
        stray.report(set(), subfolders)
        files |= inside
    missing, absent, known = tables - files, [], set(tables)
    for index in views:
        of_view = {ViewPaths(root, index).relative(kind) for kind in (*kinds, "frame")}
        known |= of_view
        if of_view.isdisjoint(files):
            absent.append(index)
        else:
            missing |= of_view - files
    stray.report({name for name in files - known if name.count("/") == scene.count("/") + 2}, set())
    if not unfinished:
        _report_missing(missing, findings)
    recorded = sorted(_recorded(root, number, count))
    return SceneContents(views, recorded, absent, frozenset(missing))


def _recorded(root: Path, number: int, count: int) -> set[int]:
    """The views of a scene that have a record."""
    folder = f"{scene_folder(number)}/frame"
    try:
        names = set(os.listdir(root / folder))
    except OSError:
        return set()
    return {index for index in scene_views(number, count) if ViewPaths(root, index).file("frame").name in names}


def _listed(root: Path, folder: str, findings: Findings) -> tuple[set[str], set[str]]:
    """Files and folders in a folder, relative to ``root``; anything that is no folder counts as a file."""
    files: set[str] = set()
    folders: set[str] = set()
    try:
        with os.scandir(root / folder) as entries:
            for entry in entries:
                name = f"{folder}/{entry.name}" if folder else entry.name
                if entry.is_symlink() and not Path(os.path.realpath(entry)).is_relative_to(os.path.realpath(root)):
                    found = "found a link that leads out of the folder: put a copy in its place"
                    findings.add("links that lead out", f"{name}: expected a part of the dataset, {found}")
                (folders if _is_folder(entry) else files).add(name)
    except OSError as error:
        findings.add("damaged files", f"{folder or root}: cannot list the folder ({error.strerror or error})")
    return files, folders


def _is_folder(entry: os.DirEntry) -> bool:
    try:
        return entry.is_dir()
    except OSError:  # a link to itself
        return False


def _report_missing(missing: Iterable[str], findings: Findings) -> None:
    for name in sorted(missing):
        findings.add("missing files", f"{name}: expected a file, found none")


@dataclass(frozen=True)
class _Stray:
    """Reports what is not of the dataset."""

    findings: Findings
    dataset: str
    unfinished: bool

    def report(self, files: set[str], folders: set[str], *, notes: bool = False) -> None:
        """Report files and folders; with ``notes``, not those that people put beside ``dataset.json``."""
        for name in sorted(files):
            base = PurePosixPath(name).name
            if base.startswith(PARTIAL):
                if not self.unfinished:
                    self.findings.add("stray files", f"{name}: left by a run that was stopped: remove it")
            elif base not in DESKTOP_FILES and not (notes and (base[0] == "." or _suffix(base) in NOTES)):
                self.findings.add("stray files", f"{name}: expected no such file in {self.dataset}")
        for name in sorted(folders):
            if not (notes and PurePosixPath(name).name[0] == "."):
                self.findings.add("stray files", f"{name}: expected no such folder in {self.dataset}")


def _suffix(name: str) -> str:
    return PurePosixPath(name).suffix.lower()
