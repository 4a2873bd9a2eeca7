"""What no file of a dataset can be, to be put in the place of one."""

import os
from collections.abc import Callable
from pathlib import Path

import pytest

from oneframe.files.content import LARGEST_INPUT

_posix_only = pytest.mark.skipif(os.name != "posix", reason="pipes, devices and sparse files of POSIX")


def _huge(path: Path) -> None:
    path.touch()
    os.truncate(path, 8 * LARGEST_INPUT)


def _pipe(path: Path) -> None:
    os.mkfifo(path)


def _device(path: Path) -> None:
    path.symlink_to("/dev/zero")


def _placed(make: Callable[[Path], None]) -> Callable[[Path], None]:
    def place(path: Path) -> None:
        path.unlink(missing_ok=True)
        make(path)

    return place


impossible = pytest.mark.parametrize(
    "place",
    [pytest.param(_placed(make), id=make.__name__[1:], marks=_posix_only) for make in (_huge, _pipe, _device)],
)
"""None of them may be waited for, or read into memory."""
