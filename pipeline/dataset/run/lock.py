"""Locks of a dataset's folder, by the system, which releases them when the process ends in any way.

Where the file system has no locks, as some Lustre and NFS mounts, everybody gets them. Nothing is lost then, as runs of
one dataset write the same bytes, and each file whole; only the work is done twice.
"""

import errno
import os
import secrets
import time
from collections.abc import Callable
from pathlib import Path

from ...files.system_lock import BUSY, lock_by_system


class Busy(Exception):
    """Another process holds the lock."""


class FileLock:
    """A lock on a file, shared or exclusive, until :meth:`release` or the end of the process."""

    def __init__(self, path: Path, *, shared: bool) -> None:
        """Take the lock.

        Raises
        ------
        Busy
            Another process has it.
        FileNotFoundError
            Another process removed the file at this moment.
        OSError
            The file cannot be written to.
        """
        self._stream = path.open("a+b")
        try:
            self._take(shared=shared)
            if not os.path.samestat(os.fstat(self._stream.fileno()), path.stat()):
                raise FileNotFoundError(errno.ENOENT, os.strerror(errno.ENOENT), str(path))
        except BaseException:
            self.release()
            raise

    def try_exclusive(self) -> bool:
        """Try to turn a shared lock into an exclusive one; a failed attempt may lose the shared lock."""
        try:
            self._take(shared=False)
        except Busy:
            return False
        return True

    def share(self) -> None:
        """Turn an exclusive lock into a shared one, or take the shared one that :meth:`try_exclusive` has lost.

        Raises
        ------
        Busy
            Another process has an exclusive one.
        """
        self._take(shared=True)

    def release(self) -> None:
        """Give the lock back."""
        self._stream.close()

    def _take(self, *, shared: bool) -> None:
        try:
            lock_by_system(self._stream.fileno(), shared)
        except OSError as error:
            if error.errno in BUSY:
                raise Busy from None


def wait_for(condition: Callable[[], bool], seconds: float) -> bool:
    """Wait until a condition holds, but not for longer than this; whether it holds."""
    give_up = time.monotonic() + seconds
    while not condition():
        if time.monotonic() > give_up:
            return False
        time.sleep(0.05 + 0.05 * secrets.randbelow(100) / 100)
    return True
