"""The folder that a run writes: one writer at a time, no partial files, nothing removed but what a run writes itself.

Locks and notes of an unfinished run are in ``.work``, which is removed when it is complete.
"""

import os
import re
import secrets
from collections.abc import Callable, Iterable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from types import TracebackType
from typing import Self

from ...errors import RunError
from ...files.content import create_folder, names_in, partial_name
from ...files.lock import Busy, FileLock
from ..layout import WORK

LOCK_FILES = r"lock(-[0-9]+-of-[0-9]+)?|run-[0-9a-f]{16}"
"""Files in ``.work`` of every run; the last ones are those of :func:`run_token`."""
_ATTEMPTS = 10


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


class WorkFolder:
    """Exclusive access to a folder, or a share of it; use as a context manager."""

    def __init__(self, path: Path, *, doing: str, work_files: str) -> None:
        """Take nothing yet.

        Parameters
        ----------
        path
            The folder.
        doing
            What a run does, such as ``"renders into"``.
        work_files
            Pattern of the names of files in ``.work`` beside :data:`LOCK_FILES`.
        """
        self.path, self.work = path, path / WORK
        self._doing, self._work_files = doing, f"{LOCK_FILES}|{work_files}"
        self._locks = ExitStack()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._locks.close()

    def _enter(self, *steps: Callable[[], object]) -> None:
        """Take the folder step by step; it is given back if one fails."""
        try:
            for step in steps:
                step()
        except BaseException as error:
            refusal = error
            if isinstance(error, OSError):
                refusal = RunError(
                    f"{self.path}: cannot write to the folder ({error.strerror or error}); choose another folder "
                    "(--out)"
                )
            self.__exit__(type(refusal), refusal, None)
            raise refusal from None

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
            f"{self.path}: another process {self._doing} this folder; wait for it, stop it, or choose another folder "
            "(--out)"
        )

    def _holds_only_work(self) -> bool:
        """Whether ``.work`` holds nothing that a run does not write."""
        return all(re.fullmatch(self._work_files, name) for name in names_in(self.work))

    def _remove_partial(self, folders: Iterable[tuple[str, Path]], is_own: Callable[[str], bool]) -> None:
        """Remove the temporary files of killed runs; nobody else may be writing theirs."""
        for prefix, folder in folders:
            for name in names_in(folder):
                target = partial_name(name)
                if target is not None and is_own(prefix + target):
                    (folder / name).unlink(missing_ok=True)

    def _remove_work(self) -> None:
        if os.name == "nt":
            self._locks.close()  # Windows removes no open files
        for name in names_in(self.work):
            if re.fullmatch(self._work_files, name):
                (self.work / name).unlink(missing_ok=True)
        with suppress(OSError):  # it holds files of somebody else
            self.work.rmdir()
