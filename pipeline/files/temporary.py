"""Temporary files: one folder for each task, and one error if its disk is full."""

import os
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from ..errors import RunError


@contextmanager
def temporary_folder() -> Iterator[Path]:
    """A folder without symbolic links in its path, which is removed in the end."""
    with writing_temporary():
        folder = Path(os.path.realpath(tempfile.mkdtemp(prefix="oneframe-")))
    try:
        yield folder
    finally:
        shutil.rmtree(folder, ignore_errors=True)


@contextmanager
def writing_temporary() -> Iterator[None]:
    """Turn an OSError inside the block, which writes temporary files and nothing else, into a sentence."""
    try:
        yield
    except OSError as error:
        raise unwritable_temporary(error.strerror or str(error)) from None


def unwritable_temporary(reason: str) -> RunError:
    """The error to report if a temporary file cannot be written."""
    folder = Path(os.path.realpath(tempfile.gettempdir()))
    # that of a command lies in the user's
    folder = folder.parent if folder.name.startswith("oneframe-") else folder
    return RunError(
        f"{folder}: cannot write temporary files ({reason}); free space there, or set the environment variable TMPDIR "
        "to another folder"
    )
