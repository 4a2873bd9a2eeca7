"""Read the vertices and polygons of OBJ files.

Source: Wavefront, "Object Files (.obj)" 3.0.
"""

import re
from array import array

import numpy as np

from ..errors import InputError
from ..files.numbers import unfinished_warnings

_AFTER_SLASH = re.compile(rb"(?<=[0-9])/\S*")
"""What follows the vertex of a corner v/vt/vn."""


def read_obj(data: bytes, where: str) -> tuple[np.ndarray, np.ndarray, np.ndarray, list[str]]:
    """Read the lines ``v`` and ``f``; the result is as that of :func:`oneframe.surface.ply_reader.read_ply`."""
    if b"\0" in data:
        raise InputError(f"{where}: expected a text, found binary data; the file is corrupt: copy or export it again")
    text = data.replace(b"\r\n", b"\n").replace(b"\r", b"\n").replace(b"\\\n", b" ")
    points, lengths, corners, largest, most = array("d"), array("q"), array("q"), 0, 0
    for number, line in enumerate(text.split(b"\n"), start=1):
        words = line.partition(b"#")[0].lstrip(b" \t")
        kind, words = words[:2].replace(b"\t", b" "), words[2:]
        try:
            if kind == b"v ":
                x, y, z, *_ = map(float, words.split())
                points.extend((x, y, z))
            elif kind == b"f ":
                given = [int(word) for word in _AFTER_SLASH.sub(b"", words).split()]
                # negative numbers count back from the vertices before the line
                known = len(points) // 3
                face = [index - 1 if index > 0 else known + index for index in given]
                if 0 in given or min(face, default=0) < 0:
                    raise ValueError
                if max(face, default=0) > most:
                    largest, most = number, max(face)
                lengths.append(len(face))
                corners.extend(face)
        except (ValueError, OverflowError):
            raise InputError(
                f"{where}: line {number}: expected 'v x y z', or 'f' with numbers of vertices, found "
                f"{line[:60].decode('latin-1')!r}; the file is truncated or corrupt: copy or export it again"
            ) from None
    if len(corners) and most >= len(points) // 3:
        raise InputError(
            f"{where}: line {largest}: expected vertex numbers 1..{len(points) // 3}, found {most + 1}; "
            "the file is truncated or corrupt: copy or export it again"
        )
    vertices = np.array(points, np.float64).reshape(-1, 3)
    return vertices, np.array(lengths, np.int64), np.array(corners, np.int64), unfinished_warnings(data, where)
