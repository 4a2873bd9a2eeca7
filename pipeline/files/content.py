"""Whole files: reading reports every failure as one kind of error, and writing never leaves a partial file."""

import errno
import hashlib
import os
import re
import secrets
import stat
from collections import deque
from collections.abc import Collection, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, contextmanager, suppress
from contextvars import ContextVar
from pathlib import Path
from typing import BinaryIO

from ..errors import InputError
from .lock import BUSY, lock_by_system

LARGEST_TEXT = 1 << 20
"""Bytes; a longer file cannot be one of settings, so the user chose it by mistake."""

LARGEST_FILE = 32 << 20
"""Bytes; the largest file of numbers."""

LARGEST_INPUT = 1 << 30
"""Bytes; the largest file of all that is read whole, such as a mesh."""

_FLUSHES = 8
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
