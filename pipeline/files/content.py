"""Reading files: every failure is one kind of error, and what a command has read is no output of it."""

import errno
import hashlib
import os
import re
import stat
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from contextvars import ContextVar
from pathlib import Path

from ..errors import InputError

LARGEST_TEXT = 1 << 20
"""Bytes; a longer file cannot be one of settings, so the user chose it by mistake."""

LARGEST_FILE = 32 << 20
"""Bytes; the largest file of numbers."""

LARGEST_INPUT = 1 << 30
"""Bytes; the largest file of all that is read whole, such as a mesh."""

_CONTROLS = re.compile(r"[\0-\x08\x0e-\x1f]")
_HASHES: ContextVar[dict[Path, str] | None] = ContextVar("hashes", default=None)


class CommandFiles:
    """What a command has read, and what it has been granted to write: a file is an input or an output, never both.

    ``at_end`` closes when the command does; there is none outside of one.
    """

    def __init__(self, at_end: ExitStack | None = None) -> None:
        self.at_end = at_end
        self._opened: dict[Path, str] = {}
        self._outputs: set[str] = set()

    def opens(self, path: Path, what: str) -> None:
        """Note a file that is read, and what it is to be."""
        self._opened.setdefault(path, what)

    def grants(self, path: Path) -> None:
        """Take a file, or a folder with all in it, for an output, also if it was opened."""
        self._outputs.add(os.path.realpath(path))

    def inputs(self) -> dict[Path, str]:
        """What was opened and is no output, in order of the first time -> what it was to be."""
        return {path: what for path, what in self._opened.items() if not self._is_output(path)}

    def _is_output(self, path: Path) -> bool:
        whole = Path(os.path.realpath(path))
        return any(str(place) in self._outputs for place in (whole, *whole.parents))


_FILES: ContextVar[CommandFiles | None] = ContextVar("files", default=None)


def command_files() -> CommandFiles:
    """Those of the command that runs; nothing is noted outside of :func:`files_of_command`."""
    return _FILES.get() or CommandFiles()


@contextmanager
def files_of_command() -> Iterator[None]:
    """Note what is read inside the block, which is a command of its own."""
    with ExitStack() as at_end:
        token = _FILES.set(CommandFiles(at_end))
        at_end.callback(_FILES.reset, token)
        yield


@contextmanager
def reading(path: Path, what: str, where: str | None = None, *, noted: bool = True) -> Iterator[None]:
    """Turn the errors of opening and reading ``path`` inside the block into an :class:`~oneframe.errors.InputError`.

    Parameters
    ----------
    path
        The file.
    what
        What it should be, with an article, such as ``"a case file"``.
    where
        Begins the message, such as ``"case.toml: [frame] image"``; the path if left out.
    noted
        Whether the file is an input of the command that runs; not those of a dataset's views, which are too many.
    """
    place, it = (str(path), "it") if where is None else (where, str(path))
    try:
        # before it is opened: a pipe would wait for its other end, and Windows reports no folder as such
        mode = _status(path).st_mode
        if stat.S_ISDIR(mode):
            raise InputError(f"{place}: expected {what}, cannot read {it} (a folder); give the path of a file in it")
        if not stat.S_ISREG(mode):
            raise InputError(f"{place}: expected {what}, cannot read {it} (no regular file); copy it to a file first")
        if noted:
            command_files().opens(path, what)
        yield
    except FileNotFoundError:
        # as TOML reads ".\frame.png"
        advice = "write / in paths, not \\" if set(it) & set("\b\t\f\r") else "correct the path"
        raise InputError(f"{place}: expected {what}, {it} does not exist; {advice}") from None
    except OSError as error:
        raise InputError(
            f"{place}: expected {what}, cannot read {it} ({error.strerror}); check its permissions"
        ) from None


def _status(path: Path) -> os.stat_result:
    try:
        return path.stat()
    except ValueError as error:  # a NUL or half a surrogate pair
        raise OSError(errno.EINVAL, str(error)) from None


def regular_file(path: str, flags: int) -> int:
    """The ``opener`` for ``open`` of files of a dataset or a pack: it never waits, as a pipe for its other end.

    Raises
    ------
    OSError
        A pipe, a device (which may act when it is opened, or never end) or a folder; or as ``os.open``.
    """
    if not stat.S_ISREG(os.stat(path).st_mode):
        raise OSError(errno.EINVAL, "no regular file", path)
    return os.open(path, flags)


def read_file(path: Path, most: int = LARGEST_INPUT) -> bytes:
    """Read the bytes of a file that a run has written, or that stands in its place.

    Raises
    ------
    OSError
        As for :func:`regular_file`; or it is longer than ``most`` bytes.
    """
    with open(path, "rb", opener=regular_file) as file:
        size = os.fstat(file.fileno()).st_size
        if size > most:
            raise OSError(errno.EFBIG, f"it has {size >> 20} MB", str(path))
        # no more than that: a file may grow while it is read
        return file.read(size)


def read_content(
    path: Path, what: str, where: str | None = None, most: int = LARGEST_INPUT, *, noted: bool = True
) -> bytes:
    """Read the bytes of a file that the user named.

    ``most`` is the largest number of bytes that is accepted; the rest is as for :func:`reading`.
    """
    place = path.name if where is None else where
    with reading(path, what, where, noted=noted), open(path, "rb") as file:
        size = os.fstat(file.fileno()).st_size
        if size > most:
            raise InputError(f"{place}: expected {what}, found one of {size >> 20} MB; choose another")
        # no more than that: a file may grow while it is read, and those of /proc have no size and no end
        data = file.read(size)
    if not data:
        raise InputError(f"{place}: expected {what}, found an empty file; copy or export it again")
    hashes = _HASHES.get()
    if hashes is not None:
        found = hashlib.sha256(data).hexdigest()
        if hashes.setdefault(path, found) != found:
            raise InputError(f"{place}: the file has changed while it was read; save it, and start again")
    return data


def read_beginning(path: Path, what: str, most: int, where: str | None = None) -> bytes:
    """Read up to ``most`` bytes from the beginning of a file that the user named; none of one without a size."""
    with reading(path, what, where), open(path, "rb") as file:
        return file.read(min(os.fstat(file.fileno()).st_size, most))


@contextmanager
def hashed_reading() -> Iterator[dict[Path, str]]:
    """Collect the SHA-256 of the very bytes that :func:`read_content` gives inside the block, by path."""
    hashes: dict[Path, str] = {}
    token = _HASHES.set(hashes)
    try:
        yield hashes
    finally:
        _HASHES.reset(token)


def decoded(data: bytes) -> str | None:
    """The text of a file in UTF-8, UTF-16 or, as spreadsheets save it, Windows-1252; ``None`` if it is no text."""
    encodings = ("utf-16",) if data.startswith((b"\xff\xfe", b"\xfe\xff")) else ("utf-8-sig", "cp1252")
    for encoding in encodings:
        with suppress(UnicodeDecodeError):
            text = data.decode(encoding)
            # of 256 bytes Windows-1252 lacks five: control characters tell data from text
            return None if "\0" in text or (encoding == "cp1252" and _CONTROLS.search(text)) else text
    return None


def content_named(path: Path, data: bytes) -> Path:
    """The path with a name of its content: a file of it never takes the place of another one."""
    return path.with_stem(f"{path.stem}-{hashlib.sha256(data).hexdigest()[:8]}")


def is_content_named(path: Path) -> bool:
    """Whether a file has the name of its content, as :func:`content_named` gives it and hardly anybody else."""
    match = re.fullmatch(r"(.+)-[0-9a-f]{8}", path.stem)
    try:
        return match is not None and content_named(path.with_stem(match[1]), read_file(path)) == path
    except OSError:
        return False


def names_in(folder: Path) -> list[str]:
    """The names in a folder; none if there is no such folder, or another process has just removed it.

    Raises
    ------
    OSError
        It cannot be read.
    """
    try:
        return os.listdir(folder)
    except FileNotFoundError:
        return []
