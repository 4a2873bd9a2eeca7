"""The system's lock of an open file, which it releases when the process ends in any way."""

import errno
import os

BUSY = {errno.EAGAIN, errno.EWOULDBLOCK, errno.EACCES, errno.EDEADLK}
"""What system calls answer where another process has the lock; anything else means that there are no locks."""


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
