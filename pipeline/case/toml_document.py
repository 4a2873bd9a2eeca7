"""A TOML text that is changed value by value: comments, blank lines, order, and the form of all other values stay.

Only valid TOML is edited (:mod:`tomllib` has read it before), so the scanner finds the limits of keys and values and
checks nothing. A path is a tuple of keys from the root; the entries of an array of tables have their index as a key:
``("landmarks", 0, "pixel")``.
"""

import re
import tomllib
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from decimal import Decimal, InvalidOperation
from functools import cached_property

TomlPath = tuple[str | int, ...]

_KEY = re.compile(r"""[ \t]*("(?:\\.|[^"\\])*"|'[^']*'|[A-Za-z0-9_-]+)[ \t]*""")
_STRING = re.compile(
    r'"""(?:\\.|[^\\])*?"{3,5}|' + r"'''.*?'{3,5}|" + r'"(?:\\.|[^"\\\n])*"|' + r"'[^'\n]*'", re.DOTALL
)
_SPACE = re.compile(r"(?:[ \t\r\n]+|#[^\n]*)*")
_SCALAR = re.compile(r"[^\s,\]}#]+")
_SCALAR_LINE = re.compile(r"[^#\r\n]*[^#\s]")
"""A value outside an array: it may hold a space, as dates with a time may."""


@dataclass(frozen=True)
class Statement:
    """``key = value``, or the header of a table if there is no value.

    Attributes
    ----------
    path
        Of the value, or of the header's table.
    table
        Path of the table in whose section the statement stands; of a header, its own path.
    start, end
        Its lines, from the first character of the first to behind the last one's line break.
    value
        Limits of the value's text; ``None`` for a header.
    """

    path: TomlPath
    table: TomlPath
    start: int
    end: int
    value: tuple[int, int] | None


@dataclass(frozen=True)
class TomlDocument:
    """The text of a TOML file; every change returns a new document."""

    text: str

    @cached_property
    def statements(self) -> tuple[Statement, ...]:
        """All headers and values, in the order of the file."""
        return tuple(_statements(self.text))

    @cached_property
    def newline(self) -> str:
        """The line break of the file."""
        return "\r\n" if "\r\n" in self.text else "\n"

    def value_text(self, path: TomlPath) -> str | None:
        """The text of a value as it stands in the file, or ``None`` if no statement gives it."""
        found = self._value(path)
        return None if found is None or found.value is None else self.text[slice(*found.value)]

    def has(self, path: TomlPath) -> bool:
        """Whether a statement gives this value, or something in it."""
        return any(statement.path[: len(path)] == path for statement in self.statements)

    def with_value(self, path: TomlPath, value: str) -> "TomlDocument":
        """Set a value, given as TOML; a new one goes to the end of its table, and a new table to the end of the file.

        Of an array of the same shape only those scalars change whose value does, so comments between them stay.
        """
        value = value.replace("\n", self.newline)
        found = self._value(path)
        if found is not None and found.value is not None:
            return self._spliced(_merged_value(self.text, *found.value, value))
        document = self.without(path)
        return document._with_new_value(path, value)

    def without(self, path: TomlPath) -> "TomlDocument":
        """Remove a value or a table; comments on lines of their own stay."""
        gone = [statement for statement in self.statements if statement.path[: len(path)] == path]
        return self._spliced((self._start(statement), statement.end, "") for statement in gone)

    def with_order(self, name: str, order: list[int]) -> "TomlDocument":
        """Bring the entries of an array of tables of the root into another order: a permutation of their indices."""
        if order == sorted(order):
            return self
        spans = [self._span((name, index)) for index in range(len(order))]
        texts = [self.text[start:end] for start, end in spans]
        return self._spliced((*span, texts[index]) for span, index in zip(spans, order, strict=True))

    def _start(self, statement: Statement) -> int:
        """Where a statement begins; of a header, with the blank line above it."""
        blank = self.newline * 2
        is_apart = statement.value is None and self.text[: statement.start].endswith(blank)
        return statement.start - len(self.newline) if is_apart else statement.start

    def _value(self, path: TomlPath) -> Statement | None:
        return next((each for each in self.statements if each.value is not None and each.path == path), None)

    def _span(self, path: TomlPath) -> tuple[int, int]:
        inside = [statement for statement in self.statements if statement.path[: len(path)] == path]
        return inside[0].start, inside[-1].end

    def _with_new_value(self, path: TomlPath, value: str) -> "TomlDocument":
        table, key = path[:-1], path[-1]
        near = [each for each in self.statements if _can_follow(each, table)]
        if near:
            names = ".".join(key_text(part) for part in path[len(near[-1].table) :])
            return self._inserted(near[-1].end, f"{names} = {value}")
        if not table:
            return self._inserted(0, f"{key_text(key)} = {value}")
        place = len(self.text)
        if isinstance(table[-1], int) and table[-1] > 0:
            place = self._span((*table[:-1], table[-1] - 1))[1]
        return self._inserted(place, self.newline.join(["", _header(table), f"{key_text(key)} = {value}"]))

    def _inserted(self, place: int, lines: str) -> "TomlDocument":
        before = "" if place == 0 or self.text[:place].endswith("\n") else self.newline
        return self._spliced([(place, place, f"{before}{lines}{self.newline}")])

    def _spliced(self, edits: Iterable[tuple[int, int, str]]) -> "TomlDocument":
        text = self.text
        for start, end, replacement in sorted(edits, reverse=True):
            text = text[:start] + replacement + text[end:]
        return TomlDocument(text)


def key_text(key: str | int) -> str:
    """A key as TOML, quoted where it must be."""
    name = str(key)
    if re.fullmatch(r"[A-Za-z0-9_-]+", name):
        return name
    escaped = name.replace("\\", "\\\\").replace('"', '\\"')
    return '"' + re.sub(r"[\x00-\x1f\x7f]", lambda found: f"\\u{ord(found[0]):04x}", escaped) + '"'


def _can_follow(statement: Statement, table: TomlPath) -> bool:
    """Whether a new value of a table may follow a statement: a value of that table, or its header."""
    is_inside = statement.path == table if statement.value is None else statement.path[: len(table)] == table
    return is_inside and statement.table == table[: len(statement.table)]


def _header(table: TomlPath) -> str:
    names = ".".join(key_text(part) for part in table if isinstance(part, str))
    return f"[[{names}]]" if isinstance(table[-1], int) else f"[{names}]"


def _statements(text: str) -> Iterator[Statement]:
    table: TomlPath = ()
    counts: dict[TomlPath, int] = {}
    at = 0
    while (at := _after_space(text, at)) < len(text):
        start = text.rfind("\n", 0, at) + 1
        if text[at] == "[":
            is_array = text.startswith("[[", at)
            keys, at = _keys(text, at + 1 + is_array)
            table = _resolved(keys[:-1], counts) + keys[-1:]
            if is_array:
                counts[table] = counts.get(table, 0) + 1
            table = _resolved(table, counts)
            at = _line_end(text, at + 1 + is_array)
            yield Statement(table, table, start, at, None)
        else:
            keys, at = _keys(text, at)
            first = _after_space(text, at + 1)
            last = _value_end(text, first, _SCALAR_LINE)
            at = _line_end(text, last)
            yield Statement(table + keys, table, start, at, (first, last))


def _resolved(path: TomlPath, counts: dict[TomlPath, int]) -> TomlPath:
    """The path with the index of the latest entry after every array of tables in it."""
    found: TomlPath = ()
    for part in path:
        found += (part,)
        if found in counts:
            found += (counts[found] - 1,)
    return found


def _keys(text: str, at: int) -> tuple[TomlPath, int]:
    keys: list[str | int] = []
    while True:
        found = _KEY.match(text, at)
        if found is None:
            raise ValueError(f"expected a key at character {at}")
        quoted = found[1][0] in "\"'"
        keys.append(tomllib.loads(f"key = {found[1]}")["key"] if quoted else found[1])
        at = found.end()
        if not text.startswith(".", at):
            return tuple(keys), at
        at += 1


def _after_space(text: str, at: int) -> int:
    found = _SPACE.match(text, at)
    return at if found is None else found.end()


def _line_end(text: str, at: int) -> int:
    end = text.find("\n", at)
    return len(text) if end < 0 else end + 1


def _value_end(text: str, at: int, scalar: re.Pattern[str] = _SCALAR) -> int:
    """The end of the value that begins at ``at``."""
    if text[at] not in "[{":
        found = (_STRING if text[at] in "\"'" else scalar).match(text, at)
        return at if found is None else found.end()
    return next(end for start, end, kind in _tokens(text, at) if kind == "end" and start == at)


def _tokens(text: str, at: int) -> Iterator[tuple[int, int, str]]:
    """Brackets, keys of inline tables, and scalars of the array or inline table at ``at``.

    The last token, of the kind "end", is the whole value.
    """
    start, closing = at, {"[": "]", "{": "}"}[text[at]]
    yield at, at + 1, text[at]
    at = _after_space(text, at + 1)
    while text[at] != closing:
        if closing == "}":
            begin = at
            _, at = _keys(text, at)
            yield begin, at, "key"
            at = _after_space(text, at + 1)
        if text[at] in "[{":
            for token in _tokens(text, at):
                yield token
                at = token[1]
        else:
            end = _value_end(text, at)
            yield at, end, "scalar"
            at = end
        at = _after_space(text, at)
        if text[at] == ",":
            at = _after_space(text, at + 1)
    yield at, at + 1, closing
    yield start, at + 1, "end"


def _merged_value(text: str, start: int, end: int, value: str) -> Iterator[tuple[int, int, str]]:
    """The edits that make the value between ``start`` and ``end`` the given one."""
    old = list(_tokens(text, start)) if text[start] in "[{" else [(start, end, "scalar")]
    new = list(_tokens(value, 0)) if value[0] in "[{" else [(0, len(value), "scalar")]
    pairs = list(zip(old, new, strict=False))
    alike = [_corresponds(text[a:b], kind, value[c:d], other) for (a, b, kind), (c, d, other) in pairs]
    if len(old) != len(new) or not all(alike):
        yield start, end, value
        return
    for (first, last, kind), (begin, stop, _) in pairs:
        if kind == "scalar" and not _same_scalar(text[first:last], value[begin:stop]):
            yield first, last, value[begin:stop]


def _corresponds(old: str, old_kind: str, new: str, new_kind: str) -> bool:
    if old_kind != new_kind:
        return False
    return old_kind != "key" or _keys(old, 0)[0] == _keys(new, 0)[0]


def _same_scalar(old: str, new: str) -> bool:
    """Whether two scalars have one value: exactly, since a number in metres may have more digits than a float."""
    if old == new:
        return True
    try:
        return Decimal(old) == Decimal(new)
    except InvalidOperation:
        return False
