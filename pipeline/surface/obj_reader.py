"""Read the vertices and polygons of OBJ files: line by line, and the numbers of all lines of a kind at once.

Source: Wavefront, "Object Files (.obj)" 3.0.
"""

import re

import numpy as np

from ..errors import InputError
from ..files.numbers import parsed_numbers, unfinished_warnings, with_nan

_AFTER_SLASH = re.compile(rb"(?<=[0-9])/\S*")
"""What follows the vertex of a corner v/vt/vn."""


def read_obj(data: bytes, where: str) -> tuple[np.ndarray, np.ndarray, np.ndarray, list[str]]:
    """Read the lines ``v`` and ``f``; the result is as that of :func:`oneframe.surface.ply_reader.read_ply`."""
    if b"\0" in data:
        raise InputError(f"{where}: expected a text, found binary data; the file is corrupt: copy or export it again")
    # joined lines count as one in the line numbers of messages
    text = with_nan(data).replace(b"\r\n", b"\n").replace(b"\r", b"\n").replace(b"\\\n", b" ")
    vertices: list[bytes] = []
    faces: list[bytes] = []
    vertex_lines: list[int] = []
    face_lines: list[int] = []
    before: list[int] = []
    for number, line in enumerate(text.split(b"\n"), start=1):
        line = line.partition(b"#")[0].lstrip(b" \t")
        if line[:2] in (b"v ", b"v\t"):
            vertices.append(line[2:])
            vertex_lines.append(number)
        elif line[:2] in (b"f ", b"f\t"):
            faces.append(line[2:])
            face_lines.append(number)
            before.append(len(vertices))
    points = _points(vertices, vertex_lines, where)
    lengths, given = _corners(faces, face_lines, where)
    # negative numbers count back from the vertices before the line
    known = np.repeat(np.array(before, np.int64), lengths)
    corners = np.where(given > 0, given - 1, given + known)
    wrong = (given == 0) | (corners < 0) | (corners >= len(points))
    if wrong.any():
        first = int(np.argmax(wrong))
        line_number = face_lines[int(np.searchsorted(np.cumsum(lengths), first, side="right"))]
        raise InputError(
            f"{where}: line {line_number}: expected vertex numbers 1..{len(points)} or negative ones that count back, "
            f"found {given[first]}; the file is truncated or corrupt: copy or export it again"
        )
    return points, lengths, corners, unfinished_warnings(data, where)


def _points(lines: list[bytes], numbers: list[int], where: str) -> np.ndarray:
    """``(V, 3)`` of the lines ``v``, without their keyword."""
    counts = np.array([len(line.split()) for line in lines], np.int64)
    if (counts < 3).any():
        first = int(np.argmax(counts < 3))
        raise InputError(
            f"{where}: line {numbers[first]}: expected 'v x y z', found {counts[first]} numbers; "
            "copy or export the file again"
        )
    values = _numbers(lines, numbers, np.float64, where)
    # w or a colour may follow
    return values[(np.cumsum(counts) - counts)[:, None] + np.arange(3)]


def _corners(lines: list[bytes], numbers: list[int], where: str) -> tuple[np.ndarray, np.ndarray]:
    """``(P,)`` corners per face, and all of the vertex numbers, as given, of the lines ``f`` without their keyword."""
    lines = [_AFTER_SLASH.sub(b"", line) for line in lines]
    counts = np.array([len(line.split()) for line in lines], np.int64)
    return counts, _numbers(lines, numbers, np.int64, where)


def _numbers(
    lines: list[bytes], numbers: list[int], dtype: type[np.float64] | type[np.int64], where: str
) -> np.ndarray:
    """All numbers in lines, of which the file's ``numbers`` are known."""
    found = parsed_numbers(b"\n".join(lines), dtype)
    if found is not None:
        return found
    for number, line in zip(numbers, lines, strict=True):
        for word in line.split():
            if parsed_numbers(word, dtype) is None:
                raise InputError(
                    f"{where}: line {number}: expected numbers, found {word[:30].decode('latin-1')!r}; "
                    "the file is corrupt: copy or export it again"
                )
    raise InputError(f"{where}: expected numbers, found something else; the file is corrupt: copy or export it again")
