"""The folder of a dataset run: one writer at a time, one identity for ever, nothing half-written.

``dataset.json`` holds everything that the content depends on. It is written first and never changed; a run that finds
another one stops. Locks and temporary files live in ``.work`` and are gone when the dataset is complete.
"""

import json
import os
import shutil
from contextlib import ExitStack, suppress
from pathlib import Path
from types import TracebackType

from pipeline.atomic_file import write_bytes_atomically
from pipeline.errors import RunError
from pipeline.options import Shard

RECORD = "dataset.json"
WORK = ".work"


class RunFolder:
    """Exclusive use of a dataset folder (or of one shard's part of it); use as a context manager."""

    def __init__(self, path: Path, identity: dict, shard: Shard) -> None:
        """Create or enter the folder.

        Parameters
        ----------
        path
            The dataset's folder.
        identity
            What determines the content; JSON types only.
        shard
            Different shards of the same run may share the folder.

        Raises
        ------
        RunError
            The folder cannot be written to, holds something else or another run's data, or is in use.
        """
        self.path = path
        self._locks = ExitStack()
        work = path / WORK
        try:
            foreign = path.is_dir() and any(path.iterdir()) and not (path / RECORD).exists() and not work.exists()
            if foreign:
                raise RunError(f"{path}: expected a new or empty folder or a dataset to resume, found other files")
            work.mkdir(parents=True, exist_ok=True)
            self._common_lock = self._take(work / "lock", shared=shard.count > 1)
            if shard.count > 1:
                self._take(work / f"lock-{shard.index}-of-{shard.count}", shared=False)
            self._identify(identity)
            self._remove_leftovers(shared=shard.count > 1)
        except OSError as error:
            self._locks.close()
            raise RunError(f"{path}: cannot write to the folder ({error.strerror})") from None
        except RunError:
            self._locks.close()
            raise

    def __enter__(self) -> "RunFolder":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._locks.close()

    def finish(self) -> None:
        """Remove locks and temporary files of a complete dataset, unless another shard still works in the folder."""
        with suppress(OSError):
            # a shard shares the common lock with others; alone it may have it for itself
            _lock(self._common_lock, shared=False)
            self._remove_leftovers(shared=False)
            shutil.rmtree(self.path / WORK, ignore_errors=True)

    def _take(self, path: Path, *, shared: bool) -> int:
        stream = self._locks.enter_context(path.open("a+b"))
        try:
            _lock(stream.fileno(), shared=shared)
        except OSError:
            raise RunError(
                f"{self.path}: another process renders into this folder; wait for it, stop it, or take another --out"
            ) from None
        return stream.fileno()

    def _identify(self, identity: dict) -> None:
        record = self.path / RECORD
        data = (json.dumps(identity, indent=2) + "\n").encode()
        if not record.exists():
            write_bytes_atomically(record, data)
        try:
            existing = json.loads(record.read_bytes())
        except ValueError:
            raise RunError(f"{record}: expected the record of a dataset, found no JSON; take another --out") from None
        different = sorted(_differences(existing, json.loads(data)))
        if different:
            shown = "; ".join(different[:4]) + (f" and {len(different) - 4} more" if len(different) > 4 else "")
            raise RunError(
                f"{self.path}: the folder holds the dataset of another run ({shown}); "
                "undo the change to resume it, or take another --out"
            )

    def _remove_leftovers(self, *, shared: bool) -> None:
        """Remove temporary files of a killed run; another shard's live ones are not ours to touch."""
        if not shared:
            for leftover in self.path.rglob(".partial-*"):
                leftover.unlink(missing_ok=True)


def _differences(old: object, new: object, name: str = "") -> list[str]:
    if isinstance(old, dict) and isinstance(new, dict):
        keys = old.keys() | new.keys()
        return [
            text for key in keys for text in _differences(old.get(key), new.get(key), f"{name}.{key}" if name else key)
        ]
    return [] if old == new else [f"{name} was {_short(old)}, is {_short(new)}"]


def _short(value: object) -> str:
    text = json.dumps(value)
    return text if len(text) <= 40 else text[:37] + "..."


def _lock(descriptor: int, *, shared: bool) -> None:
    """Take an advisory lock or raise OSError at once; it ends with the process, however that ends."""
    if os.name == "nt":
        import msvcrt

        os.lseek(descriptor, 0, os.SEEK_SET)
        # Windows has no shared locks here: shards are kept apart by their own lock files
        if not shared:
            msvcrt.locking(descriptor, msvcrt.LK_NBLCK, 1)  # type: ignore[attr-defined]
        return
    import fcntl

    fcntl.flock(descriptor, (fcntl.LOCK_SH if shared else fcntl.LOCK_EX) | fcntl.LOCK_NB)
