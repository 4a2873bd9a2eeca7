"""What may be written, checked by all commands and operators before any work starts.

1. An input of the same command, which it has opened or is going to, is never replaced, however its name is spelt: links
   and other cases are the same file.
2. Any other file that the user names is replaced, as by any program; no two outputs are one file.
3. A folder for several files of given names holds nothing but such files, and no input at all.
"""

import errno
import os
import re
import stat
import tempfile
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path

from ..errors import InputError, RunError
from .content import command_files
from .lock import Busy, lock_if_possible
from .writing import remove_abandoned, write_bytes_atomically

_DESKTOP_FILES = ("Thumbs.db", "desktop.ini")
ADVICE = "free space, or choose another place"


def check_outputs(outputs: Iterable[Path], inputs: Mapping[str, Path]) -> None:
    """Check before any work that every output may be written, and remove what killed runs have left beside it.

    Parameters
    ----------
    outputs
        All files that will be written.
    inputs
        The files that the command is going to read, by what they are, such as ``frame``. What it has opened is known.
    """
    protected = _Inputs(inputs)
    seen: dict[str, Path] = {}
    folders: set[Path] = set()
    for path in outputs:
        if source := protected.same_as(path):
            name, file = source
            raise InputError(f"{path}: expected a new file, found the {name} ({file}), an input; choose another name")
        # also where cases differ: the two would be one file on another computer
        other = seen.setdefault(os.path.realpath(path).casefold(), path)
        if other is not path:
            raise InputError(f"{path}: expected different names for all files to write, {other} is the same one")
        with writing(path):
            _check_replaced(path)
            if path.parent not in folders:
                _check_folder(path)
                folders.add(path.parent)
                remove_abandoned(path.parent)
    for path in seen.values():
        command_files().grants(path)


def check_own_folder(folder: Path, names: str, inputs: Mapping[str, Path], *, alone: bool = True) -> None:
    """Check that a folder, if there is one, holds nothing but what a command writes into it, and hidden files.

    It is locked for the command that runs, if that is to be ``alone`` in it.

    Parameters
    ----------
    folder
        The folder.
    names
        Regular expression of all names that the command may give to files and folders in it.
    inputs
        The files and folders that the command is going to read, by what they are.
    """
    protected = _Inputs(inputs)
    check_folder(folder, inputs)
    with writing(folder):
        found = sorted(os.listdir(folder)) if folder.exists() else []
        remove_abandoned(folder)
    for name in found:
        if not (re.fullmatch(names, name) or name.startswith(".") or name in _DESKTOP_FILES):
            raise InputError(
                f"{folder}: expected a new folder or one of this command alone, found {name} in it; "
                "choose another folder"
            )
        if source := protected.same_as(folder / name):
            raise InputError(_with_input(folder, *source))
    # Windows opens no folders
    if alone and os.name != "nt" and (at_end := command_files().at_end):
        at_end.enter_context(_locked(folder))


@contextmanager
def _locked(folder: Path) -> Iterator[None]:
    """Lock a folder, where its file system has locks; if it is made for that and stays empty, it goes again."""
    with writing(folder):
        is_new = not folder.exists()
        folder.mkdir(parents=True, exist_ok=True)
        descriptor = os.open(folder, os.O_RDONLY)
    try:
        try:
            lock_if_possible(descriptor)
        except Busy:
            raise RunError(f"{folder}: another run writes into it; wait, or choose another folder") from None
        yield
    finally:
        os.close(descriptor)
        if is_new:
            with suppress(OSError):
                folder.rmdir()


def check_folder(folder: Path, inputs: Mapping[str, Path]) -> None:
    """Check that no input is or lies in a folder whose files a command replaces."""
    whole = Path(os.path.realpath(folder))
    for name, path in _with_opened(inputs):
        places = (Path(os.path.realpath(path)), Path(os.path.realpath(path.parent)) / path.name)
        if any(whole in (place, *place.parents) for place in places):
            raise InputError(_with_input(folder, name, path))
    command_files().grants(folder)


def _with_opened(inputs: Mapping[str, Path]) -> list[tuple[str, Path]]:
    """Name and path of what the command has opened, and of these inputs."""
    opened = [(what.split(" ", 1)[-1], path) for path, what in command_files().inputs().items()]
    return [*opened, *inputs.items()]


def _with_input(folder: Path, name: str, path: Path) -> str:
    return (
        f"{folder}: expected a folder without the inputs of this run, found the {name} in it ({path}); "
        "choose another folder"
    )


@contextmanager
def writing(path: Path, advice: str = ADVICE) -> Iterator[None]:
    """Turn an OSError inside the block, which writes ``path`` and nothing else, into a sentence with advice."""
    try:
        yield
    except OSError as error:
        raise unwritable(path, error, advice) from None


def made_folder(path: Path) -> Path:
    """Create the folder of a file that is about to be written, if there is none, and give the file's path."""
    with writing(path):
        path.parent.mkdir(parents=True, exist_ok=True)
    return path


def write_output(path: Path, data: bytes) -> None:
    """Write a file, whole or not at all, in a folder that is created if there is none."""
    with writing(made_folder(path)):
        write_bytes_atomically(path, data)


def unwritable(path: Path, error: OSError, advice: str = ADVICE) -> RunError:
    """The error to report if ``path`` cannot be written."""
    return RunError(f"{path}: cannot write the file ({error.strerror}); {advice}")


class _Inputs:
    """Files that must not be replaced, found by what they are and not by how they are called."""

    def __init__(self, inputs: Mapping[str, Path]) -> None:
        self._by_number: dict[tuple[int, int], tuple[str, Path]] = {}
        self._by_path: dict[str, tuple[str, Path]] = {}
        for item in _with_opened(inputs):
            self._by_path[os.path.realpath(item[1])] = item
            with suppress(OSError):
                found = item[1].stat()
                self._by_number[found.st_dev, found.st_ino] = item

    def same_as(self, path: Path) -> tuple[str, Path] | None:
        """Name and path of the input that ``path`` is, if any."""
        try:
            found = path.stat()
        except OSError:
            return self._by_path.get(os.path.realpath(path))
        return self._by_number.get((found.st_dev, found.st_ino))


def _check_replaced(path: Path) -> None:
    try:
        mode = path.stat().st_mode
    except FileNotFoundError:
        return
    if stat.S_ISDIR(mode):
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR))
    if not stat.S_ISREG(mode):
        raise InputError(f"{path}: expected a new or an ordinary file, found a device or a pipe; choose another name")


def _check_folder(path: Path) -> None:
    """Try to create a file in the nearest folder that exists."""
    for folder in path.absolute().parents:
        with suppress(FileNotFoundError):
            os.stat(folder)
            with tempfile.TemporaryFile(dir=folder, prefix=".partial-"):
                return
