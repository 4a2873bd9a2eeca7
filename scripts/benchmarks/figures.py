"""Figures on disk: as JSON, or as a table with a row for each dataclass, below the conditions of the measurement."""

import csv
import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import fields
from pathlib import Path
from typing import Any, TypeVar

from oneframe.errors import InputError
from oneframe.evaluation.conditions import COMMENT, Conditions, write_table
from oneframe.files.content import decoded, read_content
from oneframe.files.outputs import write_output

Row = TypeVar("Row")
CONVERT: dict[object, Callable[[str], Any]] = {str: str, int: int, float: float, bool: lambda text: text == "True"}


def write_figures(path: Path, figures: Mapping[str, object]) -> None:
    """Write figures as JSON; infinite ones are ``Infinity``, as Python's json writes and reads them."""
    write_output(path, (json.dumps(figures, indent=2) + "\n").encode())


def write_rows(path: Path, rows: Sequence[Any], conditions: Conditions, *properties: str) -> None:
    """Write a table of dataclasses of one kind, with some of their properties after the fields."""
    columns = [*(field.name for field in fields(rows[0])), *properties]
    write_table(path, columns, ([getattr(row, name) for name in columns] for row in rows), conditions)


def read_rows(path: Path, kind: type[Row]) -> tuple[list[Row], list[str]]:
    """Read the rows of a table that :func:`write_rows` wrote, and its conditions, one line each."""
    lines = (decoded(read_content(path, "a table of measurements")) or "").splitlines()
    comments = [line for line in lines if line.startswith(COMMENT)]
    with expected(path):
        types = {field.name: field.type for field in fields(kind)}  # type: ignore[arg-type]
        rows = [
            kind(**{name: CONVERT[of](row[name]) for name, of in types.items()})
            for row in csv.DictReader(lines[len(comments) :])
        ]
        if not rows:
            raise ValueError("no rows")
    return rows, [line.removeprefix(COMMENT) for line in comments]


@contextmanager
def expected(path: Path, what: str = "the figures of this benchmark", do: str = "measure again") -> Iterator[None]:
    """Turn what goes wrong with the content of a file or folder into a sentence."""
    try:
        yield
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise InputError(f"{path.name}: expected {what}, found something else ({error!r}); {do}") from None


def conditions_note(conditions: Sequence[str]) -> str:
    """Configuration, versions, day and machine of a table as the small print of a chart."""
    parts = dict(line.partition(": ")[::2] for line in conditions)
    main = (each for each in parts.get("versions", "").split(", ") if each.startswith(("OneFrame", "Blender")))
    found = (parts.get("configuration"), ", ".join(main), parts.get("measured"), parts.get("machine"))
    return "; ".join(filter(None, found))
