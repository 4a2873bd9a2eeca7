"""Writing files so that a reader finds the old file or the whole new one, never a part of it."""

import errno
import os
import secrets
from pathlib import Path

from ..errors import InputError


def write_bytes_atomically(path: Path, data: bytes) -> None:
    """Write a file by way of a temporary one named ``.partial-*`` in the same folder, which is removed on failure.

    Safe against a crash of the program, not against a loss of power (nothing waits for the disk). The file gets the
    permissions that any new file gets, unlike with :mod:`tempfile`.

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


LARGEST_FILE = 64 << 20
"""Bytes: what is longer is another file, chosen by mistake."""


def file_content(path: Path, what: str) -> bytes:
    """The bytes of a file that should hold ``what``, such as ``"a camera"``.

    Raises
    ------
    InputError
        Missing, a folder, unreadable, empty, or longer than :data:`LARGEST_FILE`.
    """
    try:
        size = path.stat().st_size
        if size > LARGEST_FILE:
            raise InputError(f"{path.name}: expected a file with {what}, found one of {size >> 20} MB; choose another")
        data = path.read_bytes()
    except FileNotFoundError:
        raise InputError(f"{path}: expected a file with {what}, it does not exist; correct the path") from None
    except OSError as error:
        raise InputError(f"{path}: expected a file with {what}, cannot read it ({error.strerror})") from None
    if not data:
        raise InputError(f"{path.name}: expected a file with {what}, found an empty one; copy it again")
    return data


def decoded(data: bytes) -> str | None:
    """The text of a text file in Unicode, or ``None``."""
    encoding = "utf-16" if data.startswith((b"\xff\xfe", b"\xfe\xff")) else "utf-8-sig"
    try:
        text = data.decode(encoding)
    except UnicodeDecodeError:
        return None
    return None if "\0" in text else text
