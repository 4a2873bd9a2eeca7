"""The folder of a dataset run: one writer at a time, one identity that never changes, no partial files.

``dataset.json``, the dataset's identity, holds everything that the content depends on. A run writes it first; a run
that finds another identity stops. Locks and temporary files are in ``.work``, which is removed when the dataset is
complete.
"""

import json
import os
import shutil
import time
from contextlib import ExitStack, suppress
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType

from ..errors import InputError, RunError
from ..files.content import write_bytes_atomically
from .layout import SPLIT


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


RECORD = "dataset.json"
WORK = ".work"
LAST_SHARDS_SECONDS = 10.0
"""Shards that end together wait at most this long for each other; then the last one cleans up."""


class RunFolder:
    """Exclusive access to a dataset folder, or to one shard of it; use as a context manager."""

    def __init__(self, path: Path, identity: dict, shard: Shard) -> None:
        """Create or enter the folder.

        Parameters
        ----------
        path
            The dataset's folder.
        identity
            Everything that the content depends on; JSON types only.
        shard
            Different shards of the same run may share the folder.

        Raises
        ------
        RunError
            The folder cannot be written to, holds something else or another run's data, or is in use.
        """
        self.path = path
        self._locks = ExitStack()
        work, record = path / WORK, path / RECORD
        try:
            self._new_folders = [folder for folder in (path, *path.parents) if not folder.exists()]
            self._is_new = not record.exists()
            if not self._is_new:
                # before anything is touched
                check_identity(record, identity)
            elif path.is_dir() and any(path.iterdir()) and not work.exists():
                raise RunError(
                    f"{path}: expected a new or empty folder or a dataset to resume, found other files; "
                    "choose another folder (--out)"
                )
            work.mkdir(parents=True, exist_ok=True)
            self._common_lock = self._acquire(work / "lock", shared=shard.count > 1)
            if shard.count > 1:
                self._acquire(work / f"lock-{shard.index}-of-{shard.count}", shared=False)
            if not record.exists():
                write_bytes_atomically(record, _json(identity))
            check_identity(record, identity)
            self._remove_leftovers(shared=shard.count > 1)
        except OSError as error:
            self._locks.close()
            raise RunError(
                f"{path}: cannot write to the folder ({error.strerror}); choose another folder (--out)"
            ) from None
        except RunError:
            self._locks.close()
            raise

    def __enter__(self) -> "RunFolder":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if isinstance(error, InputError) and self._is_new:
            self._discard()
        self._locks.close()

    def finish(self) -> None:
        """Remove locks and temporary files of a complete dataset, unless another process still works in the folder."""
        # other shards of a complete dataset are about to end as well; the last one cleans up
        if self._try_exclusive(wait_seconds=LAST_SHARDS_SECONDS):
            self._remove_leftovers(shared=False)
            if os.name == "nt":
                self._locks.close()  # Windows removes no open files
            shutil.rmtree(self.path / WORK, ignore_errors=True)

    def _discard(self) -> None:
        """Remove this run's files if unusable input stopped it before its first view was finished."""
        if any((self.path / SPLIT).glob("*/frame/*.json")) or not self._try_exclusive():
            return
        for name in (SPLIT, "models", "models_eval", WORK):
            shutil.rmtree(self.path / name, ignore_errors=True)
        for name in ("camera.json", RECORD):
            (self.path / name).unlink(missing_ok=True)
        for folder in self._new_folders:
            with suppress(OSError):  # it holds files of somebody else
                folder.rmdir()

    def _try_exclusive(self, *, wait_seconds: float = 0.0) -> bool:
        """Try to turn the lock shared with other shards into an exclusive one; whether that succeeded.

        A failed attempt may lose the shared lock.
        """
        give_up = time.monotonic() + wait_seconds
        while True:
            try:
                _lock(self._common_lock, shared=False)
                return True
            except OSError:
                if time.monotonic() > give_up:
                    return False
                time.sleep(0.05)

    def _acquire(self, path: Path, *, shared: bool) -> int:
        stream = self._locks.enter_context(path.open("a+b"))
        try:
            _lock(stream.fileno(), shared=shared)
            if not os.path.samestat(os.fstat(stream.fileno()), path.stat()):
                raise FileNotFoundError  # another process has just finished the dataset and removed the file
        except OSError:
            raise RunError(
                f"{self.path}: another process renders into this folder; wait for it, stop it, or choose another "
                "folder (--out)"
            ) from None
        return stream.fileno()

    def _remove_leftovers(self, *, shared: bool) -> None:
        """Remove the temporary files of a killed run, unless other shards may be writing theirs."""
        if not shared:
            for leftover in self.path.rglob(".partial-*"):
                leftover.unlink(missing_ok=True)


def check_identity(record: Path, identity: dict) -> None:
    """Check that a dataset belongs to this run.

    Parameters
    ----------
    record
        The dataset's ``dataset.json``.
    identity
        Everything that the run's content depends on; JSON types only.

    Raises
    ------
    RunError
        The two differ, or the file is not JSON.
    """
    try:
        existing = json.loads(record.read_bytes())
    except ValueError:
        raise RunError(
            f"{record}: expected the record of a dataset, found no JSON; choose another folder (--out)"
        ) from None
    # changed files first: other differences may follow from them
    different = sorted(
        _differences(existing, json.loads(_json(identity))), key=lambda text: (not text.startswith("the file"), text)
    )
    if different:
        shown = "; ".join(different[:4]) + (f" and {len(different) - 4} more" if len(different) > 4 else "")
        raise RunError(
            f"{record.parent}: the folder holds the dataset of another run ({shown}); "
            "undo the change to resume it, or choose another folder (--out)"
        )


def _json(identity: dict) -> bytes:
    return (json.dumps(identity, indent=2) + "\n").encode()


def _differences(old: object, new: object, name: str = "") -> list[str]:
    if isinstance(old, dict) and isinstance(new, dict):
        keys = old.keys() | new.keys()
        return [
            text for key in keys for text in _differences(old.get(key), new.get(key), f"{name}.{key}" if name else key)
        ]
    if old == new:
        return []
    if name.startswith("inputs_sha256."):
        return [f"the file of the {name.removeprefix('inputs_sha256.')} has changed"]
    return [f"{name} was {_short(old)}, is {_short(new)}"]


def _short(value: object) -> str:
    text = json.dumps(value)
    return text if len(text) <= 40 else text[:37] + "..."


def _lock(descriptor: int, *, shared: bool) -> None:
    """Take an advisory lock or raise OSError at once; the system releases it when the process ends in any way."""
    if os.name == "nt":
        import msvcrt

        os.lseek(descriptor, 0, os.SEEK_SET)
        # msvcrt has no shared locks: the lock files of the shards keep them apart
        if not shared:
            msvcrt.locking(descriptor, msvcrt.LK_NBLCK, 1)  # type: ignore[attr-defined]
        return
    import fcntl

    fcntl.flock(descriptor, (fcntl.LOCK_SH if shared else fcntl.LOCK_EX) | fcntl.LOCK_NB)
