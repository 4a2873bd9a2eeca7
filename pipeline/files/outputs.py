"""What may be written: no output ever replaces an input, or a file of another kind.

The one rule of all commands and operators, applied before any work starts:

1. An input of the same command is never replaced, however its name is spelt: links and other cases are the same file.
2. A file that the user named replaces only a file of the same kind, told by its content.
3. A file that the program named (a texture beside a mesh, a fixed name in a folder) replaces only what the program
   wrote itself, and what nobody has changed since: see :mod:`oneframe.files.signature`.
"""

import errno
import os
import stat
import tempfile
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

from ..errors import InputError, RunError
from .kinds import Kind
from .signature import is_own_file


@dataclass(frozen=True)
class Output:
    """A file that a command is about to write.

    Attributes
    ----------
    path
        Where.
    kind
        What it will hold.
    is_own
        For a file that the program named: whether an existing one is its own; ``None`` if the user named it.
    """

    path: Path
    kind: Kind
    is_own: Callable[[Path], bool] | None = None


def companion(path: Path, kind: Kind, is_own: Callable[[Path], bool] = is_own_file) -> Output:
    """An output that the program named."""
    return Output(path, kind, is_own)


def check_outputs(outputs: Iterable[Output], inputs: Mapping[str, Path]) -> None:
    """Check before any work that every output may be written.

    Parameters
    ----------
    outputs
        All files that will be written.
    inputs
        All files that the command reads, by what they are, such as ``frame``.

    Raises
    ------
    InputError
        An output is an input, an existing file that it must not replace, or another output.
    RunError
        An output cannot be written, as far as that is known without writing it.
    """
    protected = _Inputs(inputs)
    seen: dict[str, Path] = {}
    folders: set[Path] = set()
    for output in outputs:
        path = output.path
        if source := protected.same_as(path):
            name, file = source
            raise InputError(f"{path}: expected a new file, found the {name} ({file}), an input; choose another name")
        # also where cases differ: the two would be one file on another computer
        other = seen.setdefault(os.path.realpath(path).casefold(), path)
        if other is not path:
            raise InputError(f"{path}: expected different names for all files to write, {other} is the same one")
        with writing(path):
            _check_replaced(output)
            if path.parent not in folders:
                _check_folder(path)
                folders.add(path.parent)


def check_folder(folder: Path, inputs: Mapping[str, Path]) -> None:
    """Check that no input lies in a folder whose files a command replaces.

    Raises
    ------
    InputError
        One does.
    """
    whole = Path(os.path.realpath(folder))
    for name, path in inputs.items():
        places = (Path(os.path.realpath(path)), Path(os.path.realpath(path.parent)) / path.name)
        if any(whole in place.parents for place in places):
            raise InputError(
                f"{folder}: expected a folder without the inputs of this run, found the {name} in it ({path}); "
                "choose another folder"
            )


@contextmanager
def writing(path: Path) -> Iterator[None]:
    """Turn an OSError inside the block, which writes ``path`` and nothing else, into a sentence.

    Raises
    ------
    RunError
        The file or its folder cannot be written.
    """
    try:
        yield
    except OSError as error:
        raise unwritable(path, error) from None


def made_folder(path: Path) -> Path:
    """Create the folder of a file that is about to be written, if there is none, and give the file's path.

    Raises
    ------
    RunError
        The folder cannot be created.
    """
    with writing(path):
        path.parent.mkdir(parents=True, exist_ok=True)
    return path


def unwritable(path: Path, error: OSError) -> RunError:
    """The error to report if ``path`` cannot be written."""
    if error.errno in (errno.ENOSPC, errno.EDQUOT):
        return RunError(f"{path}: cannot write the file (the disk is full); free space or choose another place")
    return RunError(f"{path}: cannot write the file ({error.strerror}); choose another place")


class _Inputs:
    """Files that must not be replaced, found by what they are and not by how they are called."""

    def __init__(self, inputs: Mapping[str, Path]) -> None:
        self._by_number: dict[tuple[int, int], tuple[str, Path]] = {}
        self._by_path: dict[str, tuple[str, Path]] = {}
        for item in inputs.items():
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


def _check_replaced(output: Output) -> None:
    path = output.path
    try:
        mode = path.stat().st_mode
    except FileNotFoundError:
        return
    if stat.S_ISDIR(mode):
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR))
    if not stat.S_ISREG(mode):
        raise InputError(f"{path}: expected a new or an ordinary file, found a device or a pipe; choose another name")
    if output.is_own is None:
        if not output.kind.is_of(path):
            raise InputError(
                f"{path}: expected no file or {output.kind.name}, found a file of another kind; choose another name"
            )
    elif not output.is_own(path):
        raise InputError(
            f"{path}: expected no such file or one that this program wrote, found another one or a changed one; "
            "move it, or choose another name"
        )


def _check_folder(path: Path) -> None:
    """Try to create a file in the nearest folder that exists."""
    for folder in path.absolute().parents:
        with suppress(FileNotFoundError):
            os.stat(folder)
            with tempfile.TemporaryFile(dir=folder, prefix=".partial-"):
                return
