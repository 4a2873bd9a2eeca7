"""The mark by which this program recognises a file that it wrote itself, and that nobody has changed since.

The mark is ``OneFrame`` and the SHA-256 of the file without the mark. It stands where every reader of the format skips
it: in a text chunk of a PNG, in a comment of a PLY's header, in a last line that is a comment of an OBJ, an MTL or an
SVG.
"""

import hashlib
import re
import struct
import zlib
from pathlib import Path

from ..errors import InputError
from .content import read_content

_KEYWORD = b"OneFrame"
_PNG = b"\x89PNG\r\n\x1a\n"
_PNG_END = struct.pack(">I", 0) + b"IEND" + struct.pack(">I", zlib.crc32(b"IEND"))
_PLY = re.compile(rb"ply\nformat [^\n]*\n")
_PLY_MARK = re.compile(rb"comment OneFrame [0-9a-f]{64}\n")
_LAST_LINE = re.compile(rb"(?:# OneFrame [0-9a-f]{64}|<!-- OneFrame [0-9a-f]{64} -->)\n\Z")


def signed(data: bytes) -> bytes:
    """The bytes of a PNG, PLY, OBJ, MTL or SVG file without a mark, with the mark."""
    digest = hashlib.sha256(data).hexdigest().encode()
    if data.endswith(_PNG_END):
        body = b"tEXt" + _KEYWORD + b"\0" + digest
        chunk = struct.pack(">I", len(body) - 4) + body + struct.pack(">I", zlib.crc32(body))
        return data[: -len(_PNG_END)] + chunk + _PNG_END
    if header := _PLY.match(data):
        return data[: header.end()] + b"comment " + _KEYWORD + b" " + digest + b"\n" + data[header.end() :]
    opening, closing = (b"<!-- ", b" -->\n") if data.lstrip().startswith(b"<") else (b"# ", b"\n")
    return data + opening + _KEYWORD + b" " + digest + closing


def is_signed(data: bytes) -> bool:
    """Whether the bytes are exactly what :func:`signed` gave."""
    return (bare := _without_mark(data)) is not None and signed(bare) == data


def is_own_file(path: Path) -> bool:
    """Whether a file holds exactly what this program wrote into it; false for one that cannot be read."""
    try:
        return is_signed(read_content(path, "a file"))
    except InputError:
        return False


def _without_mark(data: bytes) -> bytes | None:
    if data.startswith(_PNG):
        size = 12 + len(_KEYWORD) + 1 + 64
        return data[: -len(_PNG_END) - size] + _PNG_END
    if header := _PLY.match(data):
        mark = _PLY_MARK.match(data, header.end())
        return None if mark is None else data[: header.end()] + data[mark.end() :]
    mark = _LAST_LINE.search(data, max(0, len(data) - 100))
    return None if mark is None else data[: mark.start()]
