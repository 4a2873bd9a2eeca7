"""Locks of a dataset's folder: those of the system, or files where the file system has none.

Some Lustre and NFS mounts have no locks. There a process claims the folder by a file that it creates and touches every
few seconds. A claim ends when its file is removed, when its process has died on this machine, or when the file has not
been touched for :data:`STALE_SECONDS`, by the file system's own clock.
"""

import errno
import json
import os
import platform
import secrets
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

from ...files.content import LARGEST_TEXT, read_file

BEAT_SECONDS, STALE_SECONDS = 5.0, 60.0
BUSY = {errno.EAGAIN, errno.EWOULDBLOCK, errno.EACCES, errno.EDEADLK}
"""What system calls answer where another process has the lock; anything else means that there are no such locks."""

SystemLock = Callable[[int, bool], None]
"""Takes an advisory lock on an open file, shared or not, or raises OSError at once."""


class Busy(Exception):
    """Another process holds the lock."""


class FileLock:
    """A lock on a file, shared or exclusive, until :meth:`release` or the end of the process."""

    def __init__(self, path: Path, *, shared: bool, system_lock: SystemLock | None = None) -> None:
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
        self._lock = system_lock or lock_by_system
        self._path = path
        self._claim: _Claim | None = None
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
        if self._claim is not None:
            self._claim.end()

    def _take(self, *, shared: bool) -> None:
        if self._claim is None:
            try:
                self._lock(self._stream.fileno(), shared)
                return
            except OSError as error:
                if error.errno in BUSY:
                    raise Busy from None
                self._claim = _Claim(self._path)
        self._claim.take(shared=shared)


def lock_by_system(descriptor: int, shared: bool) -> None:
    """Take a lock of the system, which it releases when the process ends in any way; OSError at once if it cannot."""
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


class _Claim:
    """A lock as a file ``<name>.<token>.claim`` beside the file to lock, with the state in its content.

    Every process has a file of its own, so nobody ever writes to or replaces that of another; a stale one is removed.
    A process first writes its claim and then looks for those of others, so of two at the same time at most one gets
    the lock.
    """

    def __init__(self, path: Path) -> None:
        self._prefix = f"{path.name}."
        self._file = path.with_name(f"{path.name}.{secrets.token_hex(8)}.claim")
        self._stop = threading.Event()
        self._shared: bool | None = None

    def take(self, *, shared: bool) -> None:
        before, self._shared = self._shared, shared
        self._write()
        if any(not (shared and other.get("shared")) for other in self._others()):
            self._shared = before
            if before is None:
                self._file.unlink(missing_ok=True)
            else:
                self._write()
            raise Busy
        if before is None:
            threading.Thread(target=self._beat, daemon=True).start()

    def end(self) -> None:
        self._stop.set()
        self._file.unlink(missing_ok=True)

    def _write(self) -> None:
        content = {"machine": _machine(), "process": os.getpid(), "shared": self._shared}
        partial = self._file.with_suffix(".new")
        partial.write_text(json.dumps(content | {"started": _start_of(os.getpid())}))
        os.replace(partial, self._file)

    def _others(self) -> list[dict]:
        """The claims of living processes; files of dead ones are removed."""
        living, now = [], self._file.stat().st_mtime
        for path in self._file.parent.glob(f"{self._prefix}*.claim"):
            if path == self._file:
                continue
            try:
                content, age = json.loads(read_file(path, LARGEST_TEXT)), now - path.stat().st_mtime
            except FileNotFoundError:
                continue
            except ValueError:
                content, age = {}, now - path.stat().st_mtime
            if age > STALE_SECONDS or (isinstance(content, dict) and _has_died(content)):
                path.unlink(missing_ok=True)
            else:
                living.append(content if isinstance(content, dict) else {})
        return living

    def _beat(self) -> None:
        while not self._stop.wait(BEAT_SECONDS):
            with suppress(OSError):
                os.utime(self._file)


def _has_died(claim: dict) -> bool:
    """Whether a process of this machine has ended, or another one has its number now."""
    process = claim.get("process")
    if claim.get("machine") != _machine() or not isinstance(process, int) or os.name == "nt":
        return False
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return True
    except OSError:
        return False
    started = _start_of(process)
    return started is not None and started != claim.get("started")


def _machine() -> str:
    """A name that no other machine or container has, under which a number means the same process."""
    parts = [platform.node()]
    with suppress(OSError):
        parts += [Path("/proc/sys/kernel/random/boot_id").read_text().strip(), os.readlink("/proc/self/ns/pid")]
    return " ".join(parts)


def _start_of(process: int) -> str | None:
    """When a process started, in ticks since the machine did; ``None`` where there is no ``/proc``."""
    try:
        return Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()[19]
    except (OSError, IndexError):
        return None


def wait_for(condition: Callable[[], bool], seconds: float) -> bool:
    """Wait until a condition holds, but not for longer than this; whether it holds."""
    give_up = time.monotonic() + seconds
    while not condition():
        if time.monotonic() > give_up:
            return False
        time.sleep(0.05 + 0.05 * secrets.randbelow(100) / 100)
    return True
