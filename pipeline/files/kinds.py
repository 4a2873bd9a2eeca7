"""Kinds of files, told by their content: a file may only replace one of its own kind.

Imports neither numpy nor Blender: ``--help`` must not wait for them.
"""

import json
import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from .content import LARGEST_FILE, decoded

HEAD_BYTES = 64 * 1024
"""Length of the beginning that tells the kind of a file too long to be one of numbers or settings."""


@dataclass(frozen=True)
class Kind:
    """A kind of file: its name in messages, with an article, and a test of a file's content.

    The test gets the whole content, or of a long file the first :data:`HEAD_BYTES`.
    """

    name: str
    matches: Callable[[bytes], bool]

    def is_of(self, path: Path) -> bool:
        """Whether an existing file is of this kind; an empty one is of every kind: it has nothing to lose.

        Raises
        ------
        OSError
            The file cannot be read.
        """
        with open(path, "rb") as file:
            size = path.stat().st_size
            data = file.read(HEAD_BYTES if size > LARGEST_FILE else size)
        return not data or self.matches(data)


def beginning(*starts: bytes) -> Callable[[bytes], bool]:
    """A test for content that begins with one of these bytes."""
    return lambda data: data.startswith(starts)


def statements(*words: str) -> Callable[[bytes], bool]:
    """A test for text whose first line that is no comment begins with one of these words."""
    pattern = re.compile(rb"(?:\s*(?:#[^\n]*)?\n)*\s*(?:%s)(?:\s|\Z)" % b"|".join(map(str.encode, words)))
    return lambda data: pattern.match(data) is not None


def json_object(*keys: str) -> Callable[[bytes], bool]:
    """A test for a JSON object that has all of these keys."""

    def matches(data: bytes) -> bool:
        table = _parsed(data)
        return isinstance(table, dict) and table.keys() >= set(keys)

    return matches


def json_array(*keys: str) -> Callable[[bytes], bool]:
    """A test for a JSON list of objects that have all of these keys."""

    def matches(data: bytes) -> bool:
        entries = _parsed(data)
        return isinstance(entries, list) and all(isinstance(e, dict) and e.keys() >= set(keys) for e in entries)

    return matches


def _parsed(data: bytes) -> object:
    try:
        return json.loads(decoded(data) or "")
    except (ValueError, RecursionError):
        return None


def csv_table(header: str) -> Callable[[bytes], bool]:
    """A test for a CSV table with exactly this header."""
    return lambda data: data.split(b"\n", 1)[0].rstrip(b"\r") == header.encode()


PNG = Kind("a PNG image", beginning(b"\x89PNG\r\n\x1a\n"))
SVG = Kind("an SVG image", lambda data: b"<svg" in data[:HEAD_BYTES])
MP4 = Kind("an MP4 video", lambda data: data[4:8] == b"ftyp")
GLB = Kind("a GLB model", beginning(b"glTF"))
PLY = Kind("a PLY mesh", beginning(b"ply\n", b"ply\r"))
OBJ = Kind("an OBJ mesh", statements("mtllib", "o", "g", "s", "v", "vn", "vt", "usemtl"))
MTL = Kind("an MTL file", statements("newmtl"))
