"""Locks of a dataset's folder, by the system, which releases them when the process ends in any way.

Where the file system has no locks, as some Lustre and NFS mounts, everybody gets them. Nothing is lost then, as runs of
one dataset write the same bytes, and each file whole; only the work is done twice.
"""

import errno
import os
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
            try:
                lock_by_system(self._stream.fileno(), shared)
            except OSError as error:
                if error.errno in BUSY:
                    raise Busy from None
            if not os.path.samestat(os.fstat(self._stream.fileno()), path.stat()):
                raise FileNotFoundError(errno.ENOENT, os.strerror(errno.ENOENT), str(path))
        except BaseException:
            self.release()
            raise

    def release(self) -> None:
        """Give the lock back."""
        self._stream.close()
