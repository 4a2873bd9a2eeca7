"""The folder of a dataset run: one writer at a time, one identity that never changes, no partial files.

``dataset.json``, the dataset's description, holds everything that the content depends on. A run writes it first; a run
that finds another one stops. See :mod:`oneframe.dataset.run.work_folder`.
"""

import json
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType

import numpy as np

from ...errors import InputError, RunError
from ...files.content import LARGEST_TEXT, partial_name, read_file, write_bytes_atomically
from .. import layout
from ..checksums import keep_checksums
from ..identity import COUNT, description_bytes, identity_of
from ..layout import (
    FOLDERS,
    RECORD,
    SCENE_TABLES,
    SPLIT,
    VIDEO_FILES,
    WORK,
    is_own_file,
    own_folders,
    scene_count,
    scene_folder,
)
from .lock import Busy, wait_for
from .same_run import check_count, check_description, holds_views_of, is_cut_off
from .work_folder import WorkFolder


@dataclass(frozen=True)
class Shard:
    """Shard ``index`` (counted from 0) of ``count`` shards of the views."""

    index: int = 0
    count: int = 1

    def views(self, total: int, views_per_scene: int) -> range:
        """The views of this shard: contiguous, and whole scenes if there are enough of them."""
        unit = views_per_scene if total >= views_per_scene * self.count else 1
        units = -(-total // unit)
        first, last = (units * shard // self.count for shard in (self.index, self.index + 1))
        return range(min(first * unit, total), min(last * unit, total))


def parse_shard(text: str) -> Shard:
    """Parse ``"I/N"``, I from 0 to N - 1.

    Raises
    ------
    InputError
        The text is something else.
    """
    try:
        index, count = (int(part) for part in text.split("/"))
    except ValueError:
        raise InputError(f"--shard: expected I/N such as 0/4, found {text!r}") from None
    if not 0 <= index < count:
        raise InputError(f"--shard: expected I/N with I counted from 0 to N - 1, found {text!r}")
    return Shard(index, count)


LAST_SHARDS_SECONDS = 10.0
"""Shards that start or end together wait at most this long for each other."""


class RunFolder(WorkFolder):
    """Exclusive access to a dataset folder, or to one shard of it; use as a context manager."""

    def __init__(
        self,
        path: Path,
        description: Mapping[str, object],
        shard: Shard,
        *,
        poses: np.ndarray | None = None,
    ) -> None:
        """Create or enter the folder.

        Parameters
        ----------
        path
            The dataset's folder.
        description
            Everything that the content depends on; JSON types only.
        shard
            Different shards of the same run may share the folder.
        poses
            ``(N, 4, 4)`` listed ``cam_from_model``, mm, or ``None`` if the poses are drawn.

        Raises
        ------
        RunError
            The folder cannot be written to, holds something else or another run's data, or is in use. Nothing in it
            has been touched then.
        """
        super().__init__(path, doing="renders into", work_files=r"surface-[0-9a-f]{16}\.npz")
        self._description = description
        self._poses = poses
        self._shared = shard.count > 1
        self._is_new = False
        self._new_folders: list[Path] = []

        def lock() -> None:
            is_new = self._holds_nothing()
            self._common = self._acquire("lock", shared=self._shared)
            self._is_new = is_new
            if self._shared:
                self._acquire(f"lock-{shard.index}-of-{shard.count}")

        def look() -> None:
            self._new_folders = [folder for folder in (path, *path.parents) if not folder.exists()]

        steps = [look, self._check_description, lock, self._write_description]
        self._enter(*steps, *(() if self._shared else (self._remove_leftovers,)))

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if isinstance(error, InputError | RunError) and self._is_new:
            with suppress(OSError):  # a broken disk is no second error
                self._discard()
        super().__exit__(kind, error, trace)

    def finish(self) -> None:
        """Remove locks and temporary files of a complete dataset, unless another process still works in the folder."""
        # other shards of a complete dataset are about to end as well; the last one cleans up
        with suppress(FileNotFoundError):  # the last one was quicker
            if wait_for(self._common.try_exclusive, LAST_SHARDS_SECONDS):
                self._remove_leftovers()
                self._remove_work()

    def _holds_nothing(self) -> bool:
        """Whether the folder is new: empty, or all that is in it was left by a run that was killed as it started.

        Raises
        ------
        RunError
            It holds files of somebody else, and no dataset.
        """
        if not self.path.is_dir():
            return True
        record = self.path / RECORD
        content = read_file(record, LARGEST_TEXT) if record.exists() else b""
        if content and not is_cut_off(content, description_bytes(self._description)):
            return False
        was_run = self._holds_only_work()
        names = [entry.name for entry in self.path.iterdir()]
        others = [name for name in names if name not in (WORK, RECORD) and partial_name(name) != RECORD]
        if was_run and not others:
            return True
        # whole views may be left without their description; their records tell whose they are
        if holds_views_of(self.path, self._description, self._poses):
            count = self._description[COUNT]
            check_count(self.path, count, count, may_shrink=not self._shared)
            return False
        if record.exists() and was_run and all(name in FOLDERS or is_own_file(name) for name in others):
            return False
        raise RunError(
            f"{self.path}: expected a new or empty folder or a dataset to resume, found other files; "
            "choose another folder (--out)"
        )

    def _check_description(self) -> None:
        # other shards may not be there yet
        check_description(self.path, self._description, self._poses, may_shrink=not self._shared)

    def _write_description(self) -> None:
        """Write ``dataset.json`` if it is not there, or if the dataset grows or goes back to fewer views."""

        def is_written() -> bool:
            self._check_description()
            record, content = self.path / RECORD, description_bytes(self._description)
            had = wanted = json.loads(content)[COUNT]
            if record.exists() and not is_cut_off(existing := read_file(record, LARGEST_TEXT), content):
                had = json.loads(existing)[COUNT]
                if had == wanted:
                    if existing != content:
                        # the same values, but not as a run writes them: its sum is that of these bytes
                        write_bytes_atomically(record, content)
                    return True
                # shards that work on fewer views would write tables of these
                if self._shared and not self._common.try_exclusive():
                    return False
            # the tables are, or may be, those of another number of views
            whole = range(min(had, wanted) // layout.VIEWS_PER_SCENE)
            keep_checksums(
                self.path, identity_of(self._description), VIDEO_FILES, [scene_folder(number) for number in whole]
            )
            if had > wanted:
                self._remove_scenes(scene_count(wanted))
            write_bytes_atomically(record, content)
            return True

        if not wait_for(is_written, LAST_SHARDS_SECONDS):
            raise self._busy()
        if self._shared and not wait_for(self._is_shared_again, LAST_SHARDS_SECONDS):
            raise self._busy()

    def _is_shared_again(self) -> bool:
        try:
            self._common.share()
        except Busy:
            return False
        return True

    def _discard(self) -> None:
        """Remove this run's files if it was refused before its first view was finished."""
        if any((self.path / SPLIT).glob("*/frame/*.json")) or not self._common.try_exclusive():
            return
        folders = [*own_folders(self.path)]
        for prefix, folder in folders:
            for entry in [*folder.iterdir()]:
                if is_own_file(prefix + entry.name):
                    entry.unlink()
        self._remove_leftovers()
        self._remove_work()
        for folder in [*(folder for _, folder in reversed(folders[1:])), *self._new_folders]:
            with suppress(OSError):  # it holds files of somebody else
                folder.rmdir()

    def _remove_leftovers(self) -> None:
        self._remove_partial(own_folders(self.path), is_own_file)

    def _remove_scenes(self, first: int) -> None:
        """Remove the folders of all scenes from this one on, none of which has a view, and their tables."""
        self._remove_leftovers()
        for prefix, folder in reversed([*own_folders(self.path)]):
            scene = prefix.split("/")[1] if prefix.startswith(f"{SPLIT}/") else ""
            if scene.isdecimal() and int(scene) >= first:
                for name in SCENE_TABLES:
                    (folder / name).unlink(missing_ok=True)
                with suppress(OSError):  # it holds files of somebody else
                    folder.rmdir()
