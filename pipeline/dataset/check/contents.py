"""What is in a dataset's folder and what should be: tables missing or changed, and what is no dataset's."""

import os
import re
from pathlib import Path, PurePosixPath

from .. import layout
from ..checksums import damaged_file, read_checksums, records_hash
from ..dataset_file import Description
from ..layout import (
    CHECKSUMS,
    RECORD,
    SCENE_TABLES,
    SPLIT,
    TABLES,
    VIDEO_FILES,
    WORK,
    ViewPaths,
    other_files,
    scene_count,
    scene_folder,
)
from .findings import Findings

DAMAGED, STRAY = "damaged files", "stray files"
DESKTOP_FILES, DESKTOP_FOLDERS = {".DS_Store", "Thumbs.db", "desktop.ini"}, {"@eaDir", "__MACOSX"}
LEFT_BY_OTHERS = re.compile(r"\._.*|.*\.cache")
"""What macOS writes beside each file on other file systems, and what readers keep for themselves."""
NOTES = {"", ".md", ".txt"}
"""Suffixes of files beside ``dataset.json`` that no reader takes for data: LICENSE, README.md, notes.txt."""
PARTIAL = ".partial-"


def check_sums(root: Path, description: Description, findings: Findings, *, hashes: bool) -> int:
    """Compare all files but the views' with ``checksums.json``, without ``hashes`` their sizes only; how many hashes.

    ``hashes`` also compares the records of whole scenes with their common hash.
    """
    sums = read_checksums(root, description.identity)
    if sums is None:
        findings.add(DAMAGED, f"{CHECKSUMS}: expected the sums of this dataset's files, found none, or a damaged file")
        return 0
    video = VIDEO_FILES if (root / "video").exists() else ()
    for name in (*other_files(description.count), *video):
        known = sums.files.get(name)
        problem = f"{CHECKSUMS} does not list {name}"
        if known is not None:
            problem = damaged_file(root, name, known, hashes=hashes) or ""
        if problem:
            findings.add(DAMAGED, problem)
    if not hashes:
        return 0
    for number in range(scene_count(description.count)):
        folder = scene_folder(number)
        try:
            changed = (root / folder / "frame").is_dir() and records_hash(root / folder) != sums.records.get(folder)
        except OSError:  # such as a folder in the place of a record
            changed = True
        if changed:
            findings.add(
                DAMAGED, f"{folder}/frame: the records do not have the sha256 in {CHECKSUMS}: one was changed or lost"
            )
    return len(sums.files)


def check_names(root: Path, description: Description, findings: Findings, *, unfinished: bool) -> None:
    """Report files that no dataset of so many views has, apart from notes beside ``dataset.json``.

    The cost is that of the files that exist, whatever number of views is announced.
    """
    for folder, folders, files in os.walk(root):
        inside = Path(folder).relative_to(root).as_posix()
        folders[:] = [name for name in folders if name not in DESKTOP_FOLDERS]
        if inside == ".":
            # a run keeps its own files there, and programs theirs in hidden folders; a further dataset is another check
            folders[:] = [name for name in folders if not name.startswith(".") and name not in description.further]
        for path in (Path(folder) / base for base in (*folders, *files)):
            if path.is_symlink() and not path.resolve().is_relative_to(root.resolve()):
                found = "found a link that leads out of the folder: put a copy in its place"
                name = path.relative_to(root).as_posix()
                findings.add("links that lead out", f"{name}: expected a part of the dataset, {found}")
        for base in files:
            name = base if inside == "." else f"{inside}/{base}"
            if base in DESKTOP_FILES or LEFT_BY_OTHERS.fullmatch(base):
                continue
            if (inside == "." and _is_note(base)) or _is_of(name, description):
                continue
            if not base.startswith(PARTIAL):
                findings.add(STRAY, f"{name}: expected no such file in a dataset of {description.count} views")
            elif not unfinished:
                findings.add(STRAY, f"{name}: left by a run that was stopped: remove it")


def _is_note(base: str) -> bool:
    hidden = base.startswith(".") and not base.startswith(PARTIAL) and base != WORK
    return hidden or PurePosixPath(base).suffix.lower() in NOTES


def _is_of(name: str, description: Description) -> bool:
    """Whether a dataset has a file of this name, relative to its folder."""
    if name in (RECORD, CHECKSUMS, *TABLES, *VIDEO_FILES):
        return True
    found = re.fullmatch(rf"{SPLIT}/([0-9]+)/(?:([a-z_]+)/([0-9]+)[^/]*|([a-z_.]+))", name)
    if found is None:
        return False
    scene, kind, image, table = int(found[1]), found[2], found[3], found[4]
    if table:
        return table in SCENE_TABLES and scene < scene_count(description.count)
    index = scene * layout.VIEWS_PER_SCENE + int(image)
    has_kind = kind in (*description.kinds, "frame") and index < description.count
    return has_kind and ViewPaths(Path(), index).relative(kind) == name
