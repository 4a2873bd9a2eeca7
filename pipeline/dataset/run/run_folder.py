"""The folder of a dataset run: one writer at a time, one description that never changes, no partial files.

``dataset.json``, the dataset's description, holds everything that the content depends on. A run writes it first; a run
that finds another one stops. Locks of an unfinished run are in ``.work``, which is removed when it is complete.
"""

import json
import os
import re
import secrets
import time
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import numpy as np

from ...errors import InputError, RunError
from ...files.content import LARGEST_TEXT, names_in, read_file
from ...files.lock import Busy, FileLock
from ...files.writing import create_folder, partial_name, write_bytes_atomically
from ..identity import COUNT, LISTED, POSES_HASH, Difference, described, description_bytes, differences, poses_hash
from ..layout import CHECKSUMS, RECORD, SPLIT, WORK, is_own_file, own_folders


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


LOCK_FILES = r"lock(-[0-9]+-of-[0-9]+)?|run-[0-9a-f]{16}"
"""Files in ``.work``; the last ones are those of :func:`run_token`."""
_ATTEMPTS = 10
SHARDS_SECONDS = 10.0
"""Shards that start together wait at most this long for the one that writes ``dataset.json``."""


@contextmanager
def run_token(path: Path) -> Iterator[Path]:
    """A file in a folder, absolute, by which other machines know that they see it."""
    token = path.absolute() / WORK / f"run-{secrets.token_hex(8)}"
    create_folder(token.parent)
    token.touch()
    try:
        yield token
    finally:
        token.unlink(missing_ok=True)
        for folder in (token.parent, path):
            with suppress(OSError):  # somebody has written into it
                folder.rmdir()


class RunFolder:
    """Exclusive access to a dataset folder, or to one shard of it; use as a context manager."""

    def __init__(
        self, path: Path, description: Mapping[str, Any], shard: Shard, *, poses: np.ndarray | None = None
    ) -> None:
        """Create or enter the folder.

        Parameters
        ----------
        path
            The dataset's folder. Nothing in it has been touched if it cannot be entered.
        description
            Everything that the content depends on; JSON types only.
        shard
            Different shards of the same run may share the folder.
        poses
            ``(N, 4, 4)`` listed ``cam_from_model``, mm, or ``None`` if the poses are drawn.
        """
        self.path, self.work = path, path / WORK
        self._locks = ExitStack()
        self._description, self._poses, self._shared = description, poses, shard.count > 1
        self._is_new = False
        self._new_folders = [folder for folder in (path, *path.parents) if not folder.exists()]
        try:
            self._check_description()
            is_new = self._holds_nothing()
            if self._shared:
                self._share()
                self._acquire(f"lock-{shard.index}-of-{shard.count}")
            else:
                self._acquire("lock")
                self._remove_leftovers()
            self._is_new = is_new
            self._describe()
        except BaseException as error:
            refusal = error
            if isinstance(error, OSError):
                refusal = RunError(
                    f"{path}: cannot write to the folder ({error.strerror or error}); choose another folder (--out)"
                )
            self.__exit__(type(refusal), refusal, None)
            raise refusal from None

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if isinstance(error, InputError | RunError) and self._is_new:
            with suppress(OSError):  # a broken disk is no second error
                self._discard()
        self._locks.close()

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
        own_work = all(re.fullmatch(LOCK_FILES, name) for name in names_in(self.work))
        if own_work and all(name == WORK or partial_name(name) == RECORD for name in names):
            return True
        raise RunError(
            f"{self.path}: expected a new or empty folder or a dataset to resume, found other files; "
            "choose another folder (--out)"
        )

    def _acquire(self, name: str) -> None:
        """Acquire the exclusive lock of this name in ``.work``; RunError if another process has it."""
        # another process may just have finished and removed the file
        if not any(self._try(name) for _ in range(_ATTEMPTS)):
            raise self._busy()

    def _try(self, name: str, *, shared: bool = False) -> FileLock | None:
        """Try to take a lock; ``None`` if another process has it, or has removed its file at this moment."""
        create_folder(self.work)
        with suppress(Busy, FileNotFoundError):
            lock = FileLock(self.work / name, shared=shared)
            self._locks.callback(lock.release)
            return lock
        return None

    def _busy(self) -> RunError:
        return RunError(
            f"{self.path}: another process renders into this folder; wait for it, stop it, or choose another folder "
            "(--out)"
        )

    def _check_description(self) -> int:
        return check_description(self.path, self._description, self._poses)

    def _share(self) -> None:
        """Take the shared lock; before, one alone writes a new ``dataset.json``: others may work on fewer views."""
        give_up = time.monotonic() + SHARDS_SECONDS
        while True:
            if self._is_described():
                if self._try("lock", shared=True):
                    return
            elif lock := self._try("lock"):
                self._describe()
                lock.release()
                continue
            if time.monotonic() > give_up:
                raise self._busy()
            time.sleep(0.1)

    def _is_described(self) -> bool:
        record = self.path / RECORD
        return record.exists() and read_file(record, LARGEST_TEXT) == description_bytes(self._description)

    def _describe(self) -> None:
        """Write ``dataset.json`` if it is not there, or if the dataset grows."""
        had = self._check_description()
        if self._is_described():
            return
        if had != self._description[COUNT]:
            # the tables are those of fewer views
            (self.path / CHECKSUMS).unlink(missing_ok=True)
        write_bytes_atomically(self.path / RECORD, description_bytes(self._description))

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
        """Remove the temporary files of killed runs; nobody else may be writing theirs."""
        for prefix, folder in own_folders(self.path):
            for name in names_in(folder):
                target = partial_name(name)
                if target is not None and is_own_file(prefix + target):
                    (folder / name).unlink(missing_ok=True)

    def _remove_work(self) -> None:
        if os.name == "nt":
            self._locks.close()  # Windows removes no open files
        for name in names_in(self.work):
            if re.fullmatch(LOCK_FILES, name):
                (self.work / name).unlink(missing_ok=True)
        with suppress(OSError):  # it holds files of somebody else
            self.work.rmdir()


def check_description(
    root: Path,
    description: Mapping[str, Any],
    poses: np.ndarray | None = None,
    *,
    advice: str = "undo the change to resume it, or choose another folder (--out)",
) -> int:
    """Check that a dataset on disk, if there is one, belongs to a run and has no more views than that; how many it has.

    Parameters
    ----------
    root
        The dataset's folder.
    description
        Everything that the run's content depends on; JSON types only.
    poses
        ``(N, 4, 4)`` listed ``cam_from_model``, mm, or ``None`` if the poses are drawn. Those of the views that the
        dataset was started for must be the same.
    advice
        What to do if the two differ.
    """
    record = root / RECORD
    try:
        existing = json.loads(read_file(record, LARGEST_TEXT))
        had = existing[COUNT] + 0
    except (FileNotFoundError, NotADirectoryError):
        return 0
    except (OSError, ValueError, RecursionError, KeyError, TypeError):
        raise RunError(
            f"{record}: expected the description of a dataset, cannot read one; copy it again, or choose another "
            "folder (--out)"
        ) from None
    changes = differences(existing, description)
    if not changes and poses is not None and had <= len(poses) and existing.get(POSES_HASH) != poses_hash(poses[:had]):
        changes = [Difference(LISTED, None, None)]
    if changes:
        clauses = described(changes)
        more = f" and {len(clauses) - 4} more" * (len(clauses) > 4)
        raise RunError(
            f"{root}: the folder holds the dataset of another run ({'; '.join(clauses[:4])}{more}); {advice}"
        )
    if description[COUNT] < had:
        raise RunError(
            f"{root}: the folder holds a dataset of {had} views, and {description[COUNT]} are wanted: a dataset may "
            f"grow, but no view is removed; set the number of views to {had} or more, or choose another folder (--out)"
        )
    return int(had)
