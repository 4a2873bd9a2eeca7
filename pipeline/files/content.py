"""Whole files: reading reports every failure as one kind of error, and writing never leaves a partial file."""

import errno
import os
import secrets
import stat
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from ..errors import InputError

LARGEST_TEXT = 1 << 20
"""Bytes; a longer file cannot be one of settings, so the user chose it by mistake."""

LARGEST_FILE = 32 << 20
"""Bytes; the largest file of numbers."""

LARGEST_INPUT = 1 << 30
"""Bytes; the largest file of all that is read whole, such as a mesh."""


@contextmanager
def reading(path: Path, what: str, where: str | None = None) -> Iterator[None]:
    """Turn the errors of opening and reading ``path`` inside the block into an :class:`~pipeline.errors.InputError`.

    Parameters
    ----------
    path
        The file.
    what
        What it should be, with an article, such as ``"a case file"``.
    where
        Begins the message, such as ``"case.toml: [frame] image"``; the path if left out.

    Raises
    ------
    InputError
        Missing, a folder, a pipe or a device (which may never end), a name that no file can have, or unreadable.
    """
    place, it = (str(path), "it") if where is None else (where, str(path))
    try:
        # before it is opened: a pipe would wait for its other end, and Windows reports no folder as such
        mode = _status(path).st_mode
        if stat.S_ISDIR(mode):
            raise InputError(f"{place}: expected {what}, cannot read {it} (a folder); give the path of a file in it")
        if not stat.S_ISREG(mode):
            raise InputError(f"{place}: expected {what}, cannot read {it} (no regular file); copy it to a file first")
        yield
    except FileNotFoundError:
        raise InputError(f"{place}: expected {what}, {it} does not exist; correct the path") from None
    except OSError as error:
        raise InputError(
            f"{place}: expected {what}, cannot read {it} ({error.strerror}); check its permissions"
        ) from None


def _status(path: Path) -> os.stat_result:
    try:
        return path.stat()
    except ValueError as error:  # a NUL or half a surrogate pair
        raise OSError(errno.EINVAL, str(error)) from None


def _open_at_once(path: str, flags: int) -> int:
    """Open a file, or a pipe that has taken its place, without waiting."""
    return os.open(path, flags | getattr(os, "O_NONBLOCK", 0))


def read_content(path: Path, what: str, where: str | None = None, most: int = LARGEST_INPUT) -> bytes:
    """Read the bytes of a file that the user named.

    Parameters
    ----------
    path, what, where
        As for :func:`reading`.
    most
        Largest number of bytes that is accepted.

    Raises
    ------
    InputError
        As for :func:`reading`; or the file is empty, or longer than ``most``.
    """
    place = path.name if where is None else where
    with reading(path, what, where), open(path, "rb", opener=_open_at_once) as file:
        size = os.fstat(file.fileno()).st_size
        if size > most:
            raise InputError(f"{place}: expected {what}, found one of {size >> 20} MB; choose another")
        # no more than that: a file may grow while it is read, and those of /proc have no size and no end
        data = file.read(size)
    if not data:
        raise InputError(f"{place}: expected {what}, found an empty file; copy or export it again")
    return data


def decoded(data: bytes) -> str | None:
    """The text of a UTF-8 or UTF-16 file, or ``None`` if the bytes are no such text."""
    encoding = "utf-16" if data.startswith((b"\xff\xfe", b"\xfe\xff")) else "utf-8-sig"
    try:
        text = data.decode(encoding)
    except UnicodeDecodeError:
        return None
    return None if "\0" in text else text


def write_bytes_atomically(path: Path, data: bytes) -> None:
    """Write a file through a temporary one named ``.partial-*`` in the same folder, which is removed on failure.

    Safe against a crash of the program, not against a loss of power (the data is not flushed to the disk). The file
    gets the permissions of any new file, unlike with :mod:`tempfile`.

    Raises
    ------
    OSError
        The folder does not exist or cannot be written to, the disk is full, or ``path`` is a folder.
    """
    path = Path(path)
    if path.is_dir():
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), str(path))
    partial = path.with_name(f".partial-{secrets.token_hex(8)}")
    try:
        with open(partial, "xb") as file:
            file.write(data)
        os.replace(partial, path)
    finally:
        partial.unlink(missing_ok=True)
