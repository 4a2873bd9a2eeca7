"""The folder of a dataset run: one writer at a time, one identity that never changes, no partial files.

``dataset.json``, the dataset's description, holds everything that the content depends on. A run writes it first; a run
that finds another one stops. See :mod:`oneframe.dataset.run.work_folder`.
"""

import json
import time
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np

from ...errors import InputError, RunError
from ...files.content import LARGEST_TEXT, partial_name, read_file, write_bytes_atomically
from .. import layout
from ..checksums import keep_checksums
from ..identity import COUNT, description_bytes, identity_of
from ..layout import (
    RECORD,
    SPLIT,
    VIDEO_FILES,
    WORK,
    is_own_file,
    own_folders,
    scene_folder,
)
from .same_run import check_count, check_description, holds_views_of
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
    """Parse ``"I/N"``, I from 0 to N - 1."""
    try:
        index, count = (int(part) for part in text.split("/"))
    except ValueError:
        raise InputError(f"--shard: expected I/N such as 0/4, found {text!r}") from None
    if not 0 <= index < count:
        raise InputError(f"--shard: expected I/N with I counted from 0 to N - 1, found {text!r}")
    return Shard(index, count)


SHARDS_SECONDS = 10.0
"""Shards that start together wait at most this long for the one that writes ``dataset.json``."""


class RunFolder(WorkFolder):
    """Exclusive access to a dataset folder, or to one shard of it; use as a context manager."""

    def __init__(
        self,
        path: Path,
        description: Mapping[str, Any],
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
        """
        super().__init__(path, doing="renders into", work_files=r"surface-[0-9a-f]{16}\.npz")
        self._description = description
        self._poses = poses
        self._shared = shard.count > 1
        self._is_new = False
        self._new_folders: list[Path] = []

        def lock() -> None:
            is_new = self._holds_nothing()
            if self._shared:
                self._share()
                self._acquire(f"lock-{shard.index}-of-{shard.count}")
            else:
                self._acquire("lock")
                self._remove_leftovers()
            self._is_new = is_new
            self._describe()

        def look() -> None:
            self._new_folders = [folder for folder in (path, *path.parents) if not folder.exists()]

        self._enter(look, self._check_description, lock)

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
        if self._is_alone():
            self._remove_leftovers()
            self._remove_work()

    def _is_alone(self) -> bool:
        """Whether no other process works in the folder; a shard gives its locks back for that."""
        if self._shared:
            self._locks.close()
            with suppress(RunError):
                self._acquire("lock")
                return True
        return not self._shared

    def _holds_nothing(self) -> bool:
        """Whether the folder is new: empty, or all that is in it was left by a run that was killed as it started."""
        if not self.path.is_dir():
            return True
        if (self.path / RECORD).exists():
            return False
        names = [entry.name for entry in self.path.iterdir()]
        if self._holds_only_work() and all(name == WORK or partial_name(name) == RECORD for name in names):
            return True
        # whole views may be left without their description; their records tell whose they are
        if holds_views_of(self.path, self._description, self._poses):
            check_count(self.path, self._description)
            return False
        raise RunError(
            f"{self.path}: expected a new or empty folder or a dataset to resume, found other files; "
            "choose another folder (--out)"
        )

    def _check_description(self) -> None:
        # other shards may not be there yet
        check_description(self.path, self._description, self._poses, may_shrink=not self._shared)

    def _share(self) -> None:
        """Take the shared lock; before, one alone writes a new ``dataset.json``: others may work on fewer views."""
        give_up = time.monotonic() + SHARDS_SECONDS
        while True:
            if self._is_described():
                if self._try("lock", shared=True):
                    return
            elif lock := self._try("lock"):
                try:
                    self._describe()
                finally:
                    lock.release()
                continue
            if time.monotonic() > give_up:
                raise self._busy()
            time.sleep(0.1)

    def _is_described(self) -> bool:
        record = self.path / RECORD
        return record.exists() and read_file(record, LARGEST_TEXT) == description_bytes(self._description)

    def _describe(self) -> None:
        """Write ``dataset.json`` if it is not there, or if the dataset grows or goes back to fewer views."""
        self._check_description()
        if self._is_described():
            return
        record, wanted = self.path / RECORD, self._description[COUNT]
        had = json.loads(read_file(record, LARGEST_TEXT)).get(COUNT) if record.exists() else None
        if had != wanted:
            # the tables are, or may be, those of another number of views
            both = min(had, wanted) if isinstance(had, int) else wanted
            whole = [scene_folder(number) for number in range(both // layout.VIEWS_PER_SCENE)]
            keep_checksums(self.path, identity_of(self._description), VIDEO_FILES, whole)
        if not self._shared:
            # of scenes that never came, which readers of BOP's folders would open
            for _, folder in reversed([*own_folders(self.path)][1:]):
                with suppress(OSError):
                    folder.rmdir()
        write_bytes_atomically(record, description_bytes(self._description))

    def _discard(self) -> None:
        """Remove this run's files if it was refused before its first view was finished."""
        if any((self.path / SPLIT).glob("*/frame/*.json")) or not self._is_alone():
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
