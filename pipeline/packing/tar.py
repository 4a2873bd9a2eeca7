"""Tar archives (POSIX ustar) whose bytes depend on their members alone, and where each member lies in one.

Source: IEEE Std 1003.1, pax, "ustar Interchange Format".
"""

import tarfile
from collections.abc import Callable, Iterable
from typing import Protocol

from ..errors import InputError

BLOCK = tarfile.BLOCKSIZE
ReadAt = Callable[[int, int], bytes]
"""Reads so many bytes from an offset; fewer at the end of the file."""


class Sink(Protocol):
    """What an archive is written to."""

    def write(self, data: bytes, /) -> int:
        """Append bytes."""
        ...

    def tell(self) -> int:
        """How many there are."""
        ...


def write_member(stream: Sink, name: str, data: bytes) -> None:
    """Append a file: mode 644, without owner and time."""
    entry = tarfile.TarInfo(name)
    entry.size = len(data)
    stream.write(entry.tobuf(tarfile.USTAR_FORMAT))
    stream.write(data)
    stream.write(bytes(-len(data) % BLOCK))


def write_end(stream: Sink) -> None:
    """End an archive: two blocks of zeros, and more up to a whole record."""
    end = stream.tell() + 2 * BLOCK
    stream.write(bytes(2 * BLOCK + -end % tarfile.RECORDSIZE))


def member_places(read_at: ReadAt, where: str) -> dict[str, tuple[int, int]]:
    """Offset and size of every member's content, by name, from the headers alone.

    Parameters
    ----------
    read_at
        Reads the archive.
    where
        Names it in messages.

    Raises
    ------
    InputError
        The archive is cut off, or holds something else than files as :func:`write_member` writes them.
    """
    places: dict[str, tuple[int, int]] = {}
    offset = 0
    while True:
        header = read_at(offset, BLOCK)
        if len(header) < BLOCK:
            raise InputError(f"{where}: expected a whole shard, found one that is cut off; copy or pack it again")
        if header == bytes(BLOCK):
            return places
        name, size = _parsed(header, where)
        if name in places:
            raise InputError(f"{where}: expected each member once, found {name!r} twice; copy or pack it again")
        places[name] = (offset + BLOCK, size)
        offset += BLOCK + size + -size % BLOCK


_EMPTY = tarfile.TarInfo("").tobuf(tarfile.USTAR_FORMAT)
_NAME, _SIZE, _CHECKSUM = slice(0, 100), slice(124, 136), slice(148, 156)


def _parsed(header: bytes, where: str) -> tuple[str, int]:
    """Name and size of a member, from a header that is exactly as :func:`write_member` writes it."""
    expected = bytearray(_EMPTY)
    try:
        name, size = header[_NAME].rstrip(b"\0").decode("ascii"), int(header[_SIZE][:-1], 8)
        expected[_NAME], expected[_SIZE] = header[_NAME], b"%011o\0" % size
        # the checksum counts itself as blanks
        expected[_CHECKSUM] = b" " * 8
        expected[_CHECKSUM] = b"%06o\0 " % sum(expected)
    except ValueError:
        name, size = "", 0
    if not name or header != expected:
        raise InputError(
            f"{where}: expected a shard as oneframe pack writes it, found a damaged one; copy or pack it again"
        )
    return name, size


def ordered_names(keys: Iterable[str], suffixes: Iterable[str]) -> list[str]:
    """The names of all members of a shard, in their order."""
    suffixes = tuple(suffixes)
    return [f"{key}.{suffix}" for key in keys for suffix in suffixes]
