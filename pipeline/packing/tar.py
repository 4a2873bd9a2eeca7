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


def _parsed(header: bytes, where: str) -> tuple[str, int]:
    """Name and size of a member, from its header."""
    try:
        # the checksum counts itself as blanks
        total = sum(header) - sum(header[148:156]) + 8 * 32
        if header[257:263] == b"ustar\0" and int(header[148:154], 8) == total and header[156:157] == b"0":
            return header[: header.index(0)].decode("ascii"), int(header[124:135], 8)
    except ValueError:
        pass
    raise InputError(
        f"{where}: expected a shard as oneframe pack writes it, found a damaged one; copy or pack it again"
    )


def ordered_names(keys: Iterable[str], suffixes: Iterable[str]) -> list[str]:
    """The names of all members of a shard, in their order."""
    suffixes = tuple(suffixes)
    return [f"{key}.{suffix}" for key in keys for suffix in suffixes]
