"""Locks on files by the system, which releases them when the process ends in any way.

Where the file system has no locks, as some Lustre and NFS mounts, everybody gets them. Nothing is lost then, as runs of
one dataset write the same bytes, and each file whole; only the work is done twice.
"""

import errno
import os
from pathlib import Path

BUSY = {errno.EAGAIN, errno.EWOULDBLOCK, errno.EACCES, errno.EDEADLK}
"""What system calls answer where another process has the lock; anything else means that there are no locks."""


class Busy(Exception):
    """Another process holds the lock."""


def lock_by_system(descriptor: int, shared: bool) -> None:
    """Take an advisory lock on an open file, shared or not; OSError at once if it cannot."""
    if os.name == "nt":
        import msvcrt

        os.lseek(descriptor, 0, os.SEEK_SET)
        # msvcrt has no shared locks: the lock files of the shards keep them apart
        if not shared:
            msvcrt.locking(descriptor, msvcrt.LK_NBLCK, 1)  # type: ignore[attr-defined]
        return
    import fcntl

    kind = (fcntl.LOCK_SH if shared else fcntl.LOCK_EX) | fcntl.LOCK_NB
    try:
        fcntl.flock(descriptor, kind)
    except OSError as error:
        if error.errno in BUSY:
            raise
        fcntl.lockf(descriptor, kind)  # some mounts only have locks of POSIX


def lock_if_possible(descriptor: int, *, shared: bool = False) -> None:
    """Take such a lock where there are locks.

    Raises
    ------
    Busy
        Another process has it.
    """
    try:
        lock_by_system(descriptor, shared)
    except OSError as error:
        if error.errno in BUSY:
            raise Busy from None


class FileLock:
    """A lock on a file, shared or exclusive, until :meth:`release` or the end of the process."""

    def __init__(self, path: Path, *, shared: bool = False) -> None:
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
            lock_if_possible(self._stream.fileno(), shared=shared)
            if not os.path.samestat(os.fstat(self._stream.fileno()), path.stat()):
                raise FileNotFoundError(errno.ENOENT, os.strerror(errno.ENOENT), str(path))
        except BaseException:
            self.release()
            raise

    def release(self) -> None:
        """Give the lock back."""
        self._stream.close()
