"""What of a dataset is on disk and whole: read from the records and the folders before anything is rendered.

A view counts as finished if its record is whole and its files exist with the sizes in it. Whatever a loss of power has
left of a record is no record.
"""

import os
from collections.abc import Iterable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import asdict, dataclass, field
from pathlib import Path

import numpy as np

from ...errors import RunError
from ...poses.constraints import Rejections
from ..checksums import damaged_file
from ..identity import identity_of
from ..layout import RECORD, ViewPaths, scene_count, scene_folder, scene_views
from .resume_record import ViewRecord, read_record

MOST_SHOWN = 4


@dataclass
class Tally:
    """Sums over the records of views."""

    visible_px: int = 0
    observed_px: int = 0
    attempts: int = 0
    rejections: Rejections = field(default_factory=Rejections)

    def add(self, record: ViewRecord) -> None:
        """Add a view."""
        self.visible_px += record.gt_info.px_count_visib
        self.observed_px += record.px_count_observed
        self.attempts += record.attempts
        self.rejections += record.rejections

    def messages(self, count: int) -> list[str]:
        """What there is to say about ``count`` views: the observed fraction of the surface, and rejected poses."""
        names = {"surface": "too little surface", "observed": "too little observed surface", "clearance": "too near"}
        messages = [
            f"the frame observed {self.observed_px / self.visible_px:.1%} of the surface in the views"
            if self.visible_px
            else "no view shows any surface"
        ]
        reasons = ", ".join(f"{many} with {names[name]}" for name, many in asdict(self.rejections).items() if many)
        if reasons:
            messages.append(
                f"{self.attempts} poses drawn, {self.attempts - count} rejected ({reasons})"
                if self.attempts > count
                else f"poses that break the constraints, kept because they were listed: {reasons}"
            )
        return messages


@dataclass(frozen=True)
class Survey:
    """The views that are on disk.

    Attributes
    ----------
    finished
        Numbers of the finished views.
    damaged
        Number of a view that has a record but is not whole -> what is wrong, as a clause.
    tally
        Sums over the finished views.
    """

    finished: set[int]
    damaged: dict[int, str]
    tally: Tally


def survey_views(
    root: Path,
    views: range,
    description: Mapping[str, object],
    kinds: Sequence[str],
    *,
    poses: np.ndarray | None = None,
    hashes: bool = False,
    threads: int = 1,
) -> Survey:
    """Find out which views are finished.

    Parameters
    ----------
    root
        The dataset's folder.
    views
        The views to look for.
    description
        The description of the run.
    kinds
        Kinds of files of each view, without its record.
    poses
        ``(N, 4, 4)`` listed ``cam_from_model`` of all views of the dataset, mm, or ``None`` if they are drawn.
    hashes
        Compare the hashes of all files, not only their sizes.
    threads
        Number of threads that hash.
    """
    found, names = Survey(set(), {}, Tally()), ("frame", *kinds)
    expected = _Expected(identity_of(description), poses, kinds)
    foreign: dict[str, list[int]] = {}
    for number in range(ViewPaths(root, views.start).scene_id, scene_count(views.stop)):
        sizes = _sizes(root, scene_folder(number), names)
        here = (ViewPaths(root, index) for index in scene_views(number, views.stop) if index >= views.start)
        whole = []
        for paths in here:
            if paths.relative("frame") not in sizes:
                continue
            record, problem, whose = expected.judged(paths, sizes)
            if whose:
                foreign.setdefault(whose, []).append(paths.index)
            elif record is None or problem:
                found.damaged[paths.index] = problem
            else:
                whole.append(record)
        for record in _unchanged(root, whole, found.damaged, threads) if hashes else whole:
            found.finished.add(record.index)
            found.tally.add(record)
    for whose, numbers in foreign.items():
        raise RunError(f"{root}: {whose}: {view_ranges(numbers)}; {_advice(root, numbers)}")
    return found


@dataclass(frozen=True)
class _Expected:
    """What the views of a run must be: of its identity, at its listed poses, with files of these kinds."""

    identity: str
    poses: np.ndarray | None
    kinds: Sequence[str]

    def judged(self, paths: ViewPaths, sizes: dict[str, int]) -> tuple[ViewRecord | None, str, str]:
        """The record of a view, what is wrong with it as a clause, and whose it is if it is of another run."""
        try:
            record = read_record(paths)
        except RunError:
            return None, f"{paths.relative('frame')} is damaged", ""
        if record.identity != self.identity:
            return record, "", f"views of another run are among those of {RECORD}"
        if self.poses is not None and not np.array_equal(record.cam_from_model, self.poses[paths.index]):
            return record, "", "views of other poses than the listed ones are in the folder"
        return record, _wrong_size(record, [paths.relative(kind) for kind in self.kinds], sizes) or "", ""


def unrecorded_views(root: Path, count: int) -> list[int]:
    """Those of the first ``count`` views that have no record; nothing is read but the names of files."""
    missing: list[int] = []
    for number in range(scene_count(count)):
        paths = [ViewPaths(root, index) for index in scene_views(number, count)]
        names: set[str] = set()
        with suppress(FileNotFoundError, NotADirectoryError):
            names = set(os.listdir(paths[0].file("frame").parent))
        missing += [path.index for path in paths if path.file("frame").name not in names]
    return missing


def _sizes(root: Path, scene: str, kinds: Iterable[str]) -> dict[str, int]:
    """Sizes of the files in a scene's folders, by their names relative to the dataset: one listing a folder."""
    sizes = {}
    for kind in kinds:
        with suppress(FileNotFoundError), os.scandir(root / scene / kind) as entries:
            for entry in entries:
                with suppress(FileNotFoundError):  # a link to nothing
                    sizes[f"{scene}/{kind}/{entry.name}"] = entry.stat().st_size
    return sizes


def _advice(root: Path, views: Iterable[int]) -> str:
    first = ViewPaths(root, min(views)).relative("frame")
    return (
        f"put the right shard in their place, or remove their records (the first is {first}) and run the same command "
        "again: it renders them again"
    )


def _wrong_size(record: ViewRecord, expected: list[str], sizes: dict[str, int]) -> str | None:
    # in this order unless somebody else wrote the record
    if [*record.files] != expected and record.files.keys() != {*expected}:
        return "its record lists other files"
    for name, known in record.files.items():
        if name not in sizes:
            return f"{name} is missing"
        if sizes[name] != known.bytes:
            return f"{name} has {sizes[name]} bytes instead of {known.bytes}"
    return None


def _unchanged(root: Path, records: list[ViewRecord], damaged: dict[int, str], threads: int) -> list[ViewRecord]:
    def problem(record: ViewRecord) -> str | None:
        found = (damaged_file(root, name, known, hashes=True) for name, known in record.files.items())
        return next(filter(None, found), None)

    with ThreadPoolExecutor(threads) as pool:
        problems = [*pool.map(problem, records)]
    damaged.update({record.index: why for record, why in zip(records, problems, strict=True) if why})
    return [record for record, why in zip(records, problems, strict=True) if not why]


def to_runs(views: Iterable[int]) -> list[list[int]]:
    """Numbers as [first, last] of runs that rise by one; their order is kept."""
    runs: list[list[int]] = []
    for view in views:
        if runs and runs[-1][1] + 1 == view:
            runs[-1][1] = view
        else:
            runs.append([view, view])
    return runs


def view_ranges(views: Iterable[int]) -> str:
    """Numbers of views, in any order, as text: "0-9, 12"; only the first :data:`MOST_SHOWN` ranges are shown."""
    texts = [str(first) if first == last else f"{first}-{last}" for first, last in to_runs(sorted(views))]
    return ", ".join(texts[:MOST_SHOWN]) + (", ..." if len(texts) > MOST_SHOWN else "")
