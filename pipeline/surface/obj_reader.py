"""Read the vertices and polygons of OBJ files, in blocks of text whose bytes are looked at all at once.

Source: Wavefront, "Object Files (.obj)" 3.0.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from ..errors import InputError
from ..files.numbers import first_wrong_word, parsed_numbers, unfinished_warnings

LONGEST_LINE = 1 << 20
"""Bytes of a line of text."""

_BLOCK = 2 << 20
"""Bytes that are looked at at a time: masks and places of them take many times their size."""


def read_obj(data: bytes, where: str) -> tuple[np.ndarray, np.ndarray, np.ndarray, list[str]]:
    """Read the lines ``v`` and ``f``; the result is as that of :func:`oneframe.surface.ply_reader.read_ply`.

    Raises
    ------
    InputError
        Binary data, an overlong line, a word that is no number, a vertex of less than three, or a face with a vertex
        that does not exist: with the number of the line.
    """
    if b"\0" in data:
        raise InputError(f"{where}: expected a text, found binary data; the file is corrupt: copy or export it again")
    text = data.replace(b"\r\n", b"\n").replace(b"\r", b"\n") if b"\r" in data else data
    text = text.replace(b"\\\n", b" ")  # joined lines count as one in the line numbers of messages
    vertices: list[np.ndarray] = [np.empty((0, 3))]
    corners: list[np.ndarray] = []
    lengths: list[np.ndarray] = []
    lines: list[np.ndarray] = []
    first_line = 1
    vertex_count = 0
    for block in _blocks_of_lines(text, where):
        vertex_rows, face_rows = _rows(block, first_line)
        vertices.append(_vertices(vertex_rows, where))
        corners.append(_faces(face_rows, vertex_rows, vertex_count, where))
        vertex_count += len(vertices[-1])
        lengths.append(face_rows.counts)
        lines.append(face_rows.lines)
        first_line += block.count(b"\n")
    all_corners, all_lengths = np.concatenate(corners), np.concatenate(lengths)
    wrong = all_corners >= vertex_count
    if wrong.any():
        first = int(np.argmax(wrong))
        line = np.concatenate(lines)[_row_of(first, all_lengths)]
        raise _no_such_vertex(where, line, vertex_count, int(all_corners[first]) + 1)
    return np.concatenate(vertices), all_lengths, all_corners, unfinished_warnings(data, where)


def _blocks_of_lines(text: bytes, where: str) -> Iterator[bytes]:
    """The text in parts of whole lines."""
    start = 0
    while start < len(text):
        stop = text.find(b"\n", start + _BLOCK, start + _BLOCK + LONGEST_LINE) + 1
        if not stop and start + _BLOCK + LONGEST_LINE < len(text):
            raise InputError(
                f"{where}: expected lines of up to {LONGEST_LINE:,} bytes, found a longer one; export it again"
            )
        yield text[start : stop or len(text)]
        start = stop or len(text)


@dataclass(frozen=True)
class _Rows:
    """The lines of one kind in a block.

    Attributes
    ----------
    letters
        ``(B,)`` uint8: their bytes, without the keyword, each line with its line break.
    lines
        ``(N,)`` int32: their numbers in the file, from 1.
    counts
        ``(N,)``: their words after the keyword.
    """

    letters: np.ndarray
    lines: np.ndarray
    counts: np.ndarray


def _rows(block: bytes, first_line: int) -> tuple[_Rows, _Rows]:
    """The lines ``v`` and ``f`` of a block whose first line has that number, without comments."""
    letters = np.frombuffer(block if block.endswith(b"\n") else block + b"\n", np.uint8).copy()
    line_break = letters == ord("\n")
    ends = np.flatnonzero(line_break)
    starts = np.concatenate([[0], ends[:-1] + 1])
    keyword = starts
    if _is_blank(letters[starts]).any():
        visible = np.flatnonzero(~_is_blank(letters))  # line breaks among them, so each line has one
        keyword = visible[np.searchsorted(visible, starts)]
    of_kinds = [np.flatnonzero(letters[keyword] == kind) for kind in b"vf"]
    of_kinds = [index[_is_blank(letters[keyword[index] + 1])] for index in of_kinds]
    if b"#" in block:
        letters[_from_to(letters == ord("#"), line_break)] = ord(" ")
    rows = []
    for index in of_kinds:
        letters[keyword[index]] = ord(" ")
        lengths = (ends - starts + 1)[index]
        if len(index) and index[-1] - index[0] == len(index) - 1:
            own = letters[starts[index[0]] : ends[index[-1]] + 1]
        else:
            is_kind = np.zeros(len(starts), dtype=bool)
            is_kind[index] = True
            own = letters[np.repeat(is_kind, ends - starts + 1)]
        rows.append(_Rows(own, (first_line + index).astype(np.int32), _words(own, lengths)))
    return rows[0], rows[1]


def _words(letters: np.ndarray, lengths: np.ndarray) -> np.ndarray:
    """``(N,)`` numbers of words in lines of ``(N,)`` lengths, which begin with a space."""
    if not len(lengths):
        return np.zeros(0, dtype=np.int64)
    space = _is_space(letters)
    return np.add.reduceat(space[:-1] & ~space[1:], np.cumsum(lengths) - lengths, dtype=np.int64)


def _vertices(rows: _Rows, where: str) -> np.ndarray:
    """``(V, 3)``, of the lines ``v``."""
    numbers = _numbers(rows.letters, rows, np.float64, where)
    if (rows.counts < 3).any():
        line = rows.lines[np.argmax(rows.counts < 3)]
        raise InputError(
            f"{where}: line {line}: expected 'v x y z', found {rows.counts.min()} numbers; "
            "copy or export the file again"
        )
    if (rows.counts == 3).all():
        return numbers.reshape(-1, 3)
    return numbers[(np.cumsum(rows.counts) - rows.counts)[:, None] + np.arange(3)]  # w or a colour may follow


def _faces(rows: _Rows, vertex_rows: _Rows, vertex_count: int, where: str) -> np.ndarray:
    """Of the lines ``f``: vertex indices from 0, of all corners; ``vertex_count`` vertices precede the block."""
    letters = rows.letters
    slash = letters == ord("/")
    if slash.any():  # v/vt/vn -> v
        digit = (letters >= ord("0")) & (letters <= ord("9"))
        slash[1:] &= digit[:-1]
        letters = np.where(_from_to(slash, _is_space(letters)), np.uint8(ord(" ")), letters)
    given = _numbers(letters, rows, np.int64, where)
    if (given > 0).all():
        return given - 1
    before = np.repeat(vertex_count + np.searchsorted(vertex_rows.lines, rows.lines), rows.counts)
    corners = np.where(given > 0, given - 1, given + before)
    wrong = (given == 0) | (corners < 0)
    if wrong.any():
        first = int(np.argmax(wrong))
        line = rows.lines[_row_of(first, rows.counts)]
        raise _no_such_vertex(where, line, int(before[first]), int(given[first]))
    return corners


def _numbers(letters: np.ndarray, rows: _Rows, dtype: type[np.float64] | type[np.int64], where: str) -> np.ndarray:
    """All numbers in the letters of rows."""
    text = letters.tobytes()
    numbers = parsed_numbers(text, dtype)
    if numbers is None:
        index, word = first_wrong_word(text, dtype)
        raise InputError(
            f"{where}: line {rows.lines[index]}: expected numbers, found {word!r}; "
            "the file is corrupt: copy or export it again"
        )
    return numbers


def _no_such_vertex(where: str, line: int, vertices: int, found: int) -> InputError:
    return InputError(
        f"{where}: line {line}: expected vertex numbers 1..{vertices} or negative ones that count back, found "
        f"{found}; the file is truncated or corrupt: copy or export it again"
    )


def _row_of(word: int, counts: np.ndarray) -> int:
    """The row that holds the word with an index, of rows with ``counts`` words."""
    return int(np.searchsorted(np.cumsum(counts), word, side="right"))


def _from_to(begin: np.ndarray, end: np.ndarray) -> np.ndarray:
    """``(B,)`` bool: from each place in ``begin`` to before the next one in ``end``, both ``(B,)`` bool."""
    place = np.arange(len(begin), dtype=np.int32)
    last_begin, last_end = (np.maximum.accumulate(np.where(marks, place, -1)) for marks in (begin, end))
    return last_begin > last_end


def _is_blank(letters: np.ndarray) -> np.ndarray:
    return (letters == ord(" ")) | (letters == ord("\t"))


def _is_space(letters: np.ndarray) -> np.ndarray:
    """What separates words, as in ``bytes.split``: space, tab, line break, vertical tab, form feed, return."""
    return (letters == ord(" ")) | ((letters >= ord("\t")) & (letters <= ord("\r")))
