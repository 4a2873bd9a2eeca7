"""Tables: parse JSON and TOML, write JSON and CSV."""

import csv
import io
import json
import re
import tomllib
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any

from ..errors import InputError
from .content import LARGEST_TEXT
from .numbers import WrittenFloat
from .writing import write_bytes_atomically

MOST_LEVELS = 32
"""Of lists and tables in one another; real files have up to ten, and recursion over many more overflows the stack."""
_DEEP_KEY = re.compile(
    rf"""(?<![\w.-])(?:(?:[\w-]++|"[^"\n]*+"|'[^'\n]*+')[ \t]*+\.[ \t]*+){{{MOST_LEVELS}}}""", re.ASCII
)


def parsed_json(
    content: str | bytes,
    where: str,
    *,
    parse_int: Callable[[str], Any] = lambda digits: int(digits) if len(digits) < 19 else float(digits),
    parse_float: Callable[[str], Any] = float,
) -> Any:
    """Parse JSON.

    Parameters
    ----------
    content, where
        The text; the beginning of messages.
    parse_int, parse_float
        Convert the digits of a whole number, and of one with a decimal point or an exponent; :class:`.WrittenFloat`
        keeps the digits. Whole numbers beyond 64 bits are read as floats by default.
    """
    try:
        text = _text(content)
        table = json.loads(text, parse_float=parse_float, parse_int=parse_int, object_pairs_hook=_table)
        # fewer brackets than levels are never too deep
        if text.count("{") + text.count("[") > MOST_LEVELS:
            check_levels(table)
        return table
    except (ValueError, RecursionError) as error:
        raise InputError(f"{where}: expected JSON, found a mistake: {error}; correct it or write it again") from None


def parsed_toml(content: str | bytes, where: str) -> dict[str, Any]:
    """Parse TOML; numbers with a decimal point or an exponent keep their digits (:class:`.WrittenFloat`)."""
    if len(content) > LARGEST_TEXT:
        raise InputError(f"{where}: expected TOML, found a file of {len(content) >> 20} MB; choose another")
    try:
        text = _text(content)
        # a parser in Python takes minutes and gigabytes for thousands
        if _DEEP_KEY.search(text):
            raise ValueError(f"a key of more than {MOST_LEVELS} parts")
        table = tomllib.loads(text, parse_float=WrittenFloat)
        check_levels(table)
        _check_integers(table)
        return table
    except (ValueError, RecursionError) as error:  # tomllib's are ValueErrors
        raise InputError(f"{where}: expected TOML, found a mistake: {error}; {_advice(content, error)}") from None


def write_json(path: Path, content: object, *, indent: int | None = 2) -> None:
    """Write JSON, whole or not at all; on one line if ``indent`` is ``None``."""
    write_bytes_atomically(path, (json.dumps(content, indent=indent) + "\n").encode())


def write_csv(path: Path, header: Sequence[str], rows: Iterable[Sequence[object]]) -> None:
    """Write a table as CSV in UTF-8 with line feeds, whole or not at all; what is no Unicode in a name with escapes."""
    lines = io.StringIO(newline="")
    table = csv.writer(lines, lineterminator="\n")
    table.writerow(header)
    table.writerows(rows)
    write_bytes_atomically(path, lines.getvalue().encode(errors="backslashreplace"))


def check_levels(value: object) -> None:
    """Raise ValueError if lists and tables stand in one another more than :data:`MOST_LEVELS` deep."""
    level = [value]
    for _ in range(MOST_LEVELS + 1):
        containers = [part for part in level if isinstance(part, dict | list)]
        if not containers:
            return
        level = [
            part
            for container in containers
            for part in (container.values() if isinstance(container, dict) else container)
            if isinstance(part, dict | list)
        ]
    raise ValueError(f"lists or tables more than {MOST_LEVELS} deep in one another")


def _advice(content: str | bytes, error: Exception) -> str:
    """What to do about TOML that cannot be read: mostly another encoding, or a path of Windows."""
    if isinstance(error, UnicodeDecodeError):
        return "save it as UTF-8"
    return "correct it; write / in paths, not \\" if "\\" in _text(content) else "correct it"


def _text(content: str | bytes) -> str:
    return content if isinstance(content, str) else content.decode("utf-8-sig")


def _table(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    """A table of an object, whose keys differ: JSON's parsers take the first or the last of two."""
    table: dict[str, Any] = {}
    for key, value in pairs:
        if key in table:
            raise ValueError(f"the key {key[:60]!r} twice")
        table[key] = value
    return table


def _check_integers(value: object) -> None:
    """Refuse integers beyond TOML's 64 bits: Python reads them, but no float can hold them."""
    if isinstance(value, int) and abs(value) >= 2**63:
        raise ValueError("an integer of more than 64 bits")
    if isinstance(value, dict | list):
        for part in value.values() if isinstance(value, dict) else value:
            _check_integers(part)
