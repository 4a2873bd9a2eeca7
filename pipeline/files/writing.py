"""Writing files: whole or not at all, through a temporary file beside them."""

import errno
import os
import re
import secrets
from collections import deque
from collections.abc import Collection, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import BinaryIO

from .content import names_in, regular_file
from .lock import BUSY, lock_by_system

_FLUSHES = 8


def write_bytes_atomically(path: Path, data: bytes) -> None:
    """Write a file, whole or not at all, and durably: see :func:`written_file`."""
    with written_file(Path(path)) as stream:
        stream.write(data)


def write_undurably(path: Path, data: bytes) -> None:
    """Write a file, whole or not at all; until :func:`make_durable`, a loss of power may take or damage it.

    Raises
    ------
    OSError
        As for :func:`written_file`.
    """
    with _partial_file(path) as stream:
        stream.write(data)
        stream.flush()
        _replace(path, stream)


def make_durable(files: Collection[Path]) -> None:
    """Flush files and their folders to the disk, many at a time: it writes them together.

    Raises
    ------
    OSError
        One is missing or cannot be flushed.
    """
    with ThreadPoolExecutor(_FLUSHES) as pool:
        deque(pool.map(_flush_file, files), 0)
        # last, so that no name is without content
        deque(pool.map(_flush_folder, {path.parent for path in files}), 0)


def rename_durably(names: Mapping[Path, Path]) -> None:
    """Put files, which are on the disk, in the places of others: old path -> new path."""
    for old, new in names.items():
        os.replace(old, new)
    for folder in {new.parent for new in names.values()}:
        _flush_folder(folder)


def remove_durably(path: Path) -> None:
    """Remove a file, if it is there; a loss of power cannot bring it back."""
    with suppress(FileNotFoundError):
        path.unlink()
        _flush_folder(path.parent)


@contextmanager
def written_file(path: Path) -> Iterator[BinaryIO]:
    """A file to write to, which takes the place of ``path`` at the end of the block; nothing is left if that fails.

    It is written through a temporary file ``.partial-<16 hexadecimal digits>-<name>`` in the same folder, with the
    permissions of any new file, unlike with :mod:`tempfile`. File and folder are flushed to the disk.

    Raises
    ------
    OSError
        The folder does not exist or cannot be written to, the disk is full, or ``path`` is a folder.
    """
    with _partial_file(path) as stream:
        yield stream
        stream.flush()
        _flush(stream.fileno())
        _replace(path, stream)
        _flush_folder(path.parent)


def partial_path(path: Path) -> Path:
    """A new temporary file for ``path``, beside it."""
    # a name of 255 bytes is the longest that most file systems take
    return path.with_name(f".partial-{secrets.token_hex(8)}-{path.name[-50:]}")


def partial_name(name: str) -> str | None:
    """The name of the file that a temporary file of :func:`written_file` was for; ``None`` for other files."""
    match = re.fullmatch(r"\.partial-[0-9a-f]{16}-(.+)", name)
    return match and match[1]


def create_folder(path: Path) -> None:
    """Create a folder and those above it, durably; nothing happens if it exists.

    Raises
    ------
    OSError
        It cannot be created.
    """
    new = [folder for folder in (path, *path.parents) if not folder.exists()]
    path.mkdir(parents=True, exist_ok=True)
    for folder in new:
        _flush_folder(folder.parent)


@contextmanager
def _partial_file(path: Path) -> Iterator[BinaryIO]:
    if path.is_dir():
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), str(path))
    try:
        stream = _locked_partial(path)
    except OSError as error:
        # the message names the file that was asked for
        error.filename = str(path)
        raise
    try:
        with stream:
            yield stream
    except BaseException:
        Path(stream.name).unlink(missing_ok=True)
        raise


def _locked_partial(path: Path) -> BinaryIO:
    """A new temporary file, locked as long as it is open: :func:`remove_abandoned` tells it by that."""
    while True:
        stream = open(partial_path(path), "xb")  # noqa: SIM115  # closed by the caller
        try:
            _lock(stream)
            taken = not os.path.exists(stream.name)
        except OSError as error:
            taken = error.errno in BUSY
        if not taken:
            return stream
        # another process has found it before it was locked
        stream.close()


def remove_abandoned(folder: Path) -> None:
    """Remove the temporary files of :func:`written_file` in a folder whose processes were killed."""
    for name in names_in(folder):
        if partial_name(name) is not None:
            with suppress(OSError), open(folder / name, "r+b", opener=regular_file) as stream:
                _lock(stream)
                (folder / name).unlink()


def _lock(stream: BinaryIO) -> None:
    # Windows removes no open files, and lets nobody else write to locked ones
    if os.name != "nt":
        lock_by_system(stream.fileno(), shared=False)


def _replace(path: Path, stream: BinaryIO) -> None:
    """Put a written temporary file in its place; it is locked until it has its name."""
    if os.name == "nt":
        stream.close()  # Windows replaces no open files
    os.replace(path.with_name(Path(stream.name).name), path)


def _flush_file(path: Path) -> None:
    descriptor = os.open(path, os.O_RDWR)  # Windows flushes what may be written to
    try:
        _flush(descriptor)
    finally:
        os.close(descriptor)


def _flush_folder(folder: Path) -> None:
    if os.name == "nt":
        return  # opens no folders, and keeps names in a journal
    try:
        descriptor = os.open(folder, os.O_RDONLY)
    except PermissionError:
        return  # one that may be written to, but not read
    try:
        _flush(descriptor)
    finally:
        os.close(descriptor)


def _flush(descriptor: int) -> None:
    try:
        os.fsync(descriptor)
    except OSError as error:
        # some file systems in memory or over a network cannot
        if error.errno not in (errno.EINVAL, errno.ENOSYS, errno.EOPNOTSUPP, errno.ENOTSUP):
            raise
