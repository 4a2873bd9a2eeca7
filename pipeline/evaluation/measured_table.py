"""Tables of measurements: CSV that begins with comment lines, which hold the conditions of the measurement."""

import csv
import io
from collections.abc import Iterable, Sequence
from pathlib import Path

from ..errors import InputError
from ..files.content import decoded, read_content, write_bytes_atomically
from ..files.kinds import Kind
from .conditions import Conditions

COMMENT = "# "


def measured_table(name: str, columns: Sequence[str]) -> Kind:
    """The kind of a table with these columns; ``name`` has an article, such as "the trials of this script"."""
    header = ",".join(columns).encode()

    def matches(data: bytes) -> bool:
        first = next((line for line in data.splitlines() if not line.startswith(COMMENT.encode())), b"")
        return first == header

    return Kind(name, matches)


def table_bytes(columns: Sequence[str], rows: Iterable[Sequence[object]], conditions: Conditions) -> bytes:
    """The content of a table; floats keep six significant digits."""
    text = io.StringIO(newline="")
    text.writelines(f"{COMMENT}{line}\n" for line in conditions.lines())
    table = csv.writer(text, lineterminator="\n")
    table.writerow(columns)
    table.writerows([f"{value:.6g}" if isinstance(value, float) else value for value in row] for row in rows)
    return text.getvalue().encode()


def write_table(path: Path, columns: Sequence[str], rows: Iterable[Sequence[object]], conditions: Conditions) -> None:
    """Write a table, whole or not at all."""
    write_bytes_atomically(path, table_bytes(columns, rows, conditions))


def read_table(path: Path, columns: Sequence[str]) -> tuple[list[dict[str, str]], list[str]]:
    """Read the rows of a table that :func:`write_table` wrote, by column, and its comment lines.

    Raises
    ------
    InputError
        The file is missing, or is no table with these columns.
    """
    lines = (decoded(read_content(path, "a table of measurements")) or "").splitlines()
    comments = [line for line in lines if line.startswith(COMMENT)]
    reader = csv.DictReader(lines[len(comments) :])
    if reader.fieldnames is None or list(reader.fieldnames) != list(columns):
        raise InputError(
            f"{path.name}: expected a table with the columns {','.join(columns)}, found something else; "
            "measure it again"
        )
    rows = list(reader)
    if any(None in row or None in row.values() for row in rows):
        raise InputError(f"{path.name}: expected {len(columns)} values in every row, found others; measure it again")
    return rows, [line.removeprefix(COMMENT) for line in comments]
