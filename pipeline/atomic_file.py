"""Writing files so that a reader finds the old file or the whole new one, never a part of it."""

import errno
import os
import secrets
from pathlib import Path


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
