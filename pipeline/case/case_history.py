"""The history of a case: every pose that a person or a solver settled, with all that the case was then.

``case.history.jsonl`` beside ``case.toml`` has a line of JSON for each, with its time and the text of the case. Lines
are added, each by one write, and the older ones left alone: several programs lose nothing of each other, and a kill
loses at most the line that is being written. Whatever replaces a case file keeps what it said, see :func:`.write_case`.
"""

import datetime
import json
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ..errors import InputError
from ..files.content import LARGEST_FILE, read_content
from ..files.tables import parsed_json
from .case_file import Case, case_from_text

SUFFIX = ".history.jsonl"
MOST = 400
"""Cases that are listed, the latest ones; the file keeps all."""


@dataclass(frozen=True)
class EarlierCase:
    """A case as it was.

    Attributes
    ----------
    time
        When, in ISO 8601.
    case
        What it was.
    """

    time: str
    case: Case

    @property
    def text(self) -> str:
        """When it was, how its pose was found, and how sure that is."""
        record = self.case.alignment
        words = [record.method or "of unknown origin"]
        words += [f"checked {record.checked}"] if record.checked else []
        words += [] if record.error_px is None else [f"off by about {record.error_px:.2g} px"]
        words += [f"in doubt: {doubt}" for doubt in (record.doubt, record.refused) if doubt]
        return f"{self.time.replace('T', ' ')}: {', '.join(words)}"


def history_path(path: Path) -> Path:
    """The file of a case's history."""
    return path.with_suffix(SUFFIX)


def earlier_cases(path: Path, most: int = MOST) -> tuple[EarlierCase, ...]:
    """What the case of a file was, the latest first; nothing without a history."""
    found, lines = [], _lines(path)
    for number in range(len(lines), max(len(lines) - most, 0), -1):
        where = f"{history_path(path).name}: line {number}"
        try:
            entry = _entry(lines[number - 1])
            found.append(EarlierCase(entry["time"], case_from_text(entry["case"], path)))
        except InputError as error:
            raise InputError(f"{where}: expected an earlier case, {error}; delete the line") from None
    return tuple(found)


def add_to_history(path: Path, case: Case, text: str) -> None:
    """Add a case, with its text, to the history of a file; not twice, and not if nobody has aligned it.

    Raises
    ------
    OSError
        The history cannot be written.
    """
    if not case.posed or case.alignment.is_start:
        return
    # whatever cannot be read stays
    with suppress(InputError):
        if any(json.dumps(text) in line for line in _lines(path)):
            return
    line = json.dumps({"time": datetime.datetime.now().isoformat(timespec="seconds"), "case": text}) + "\n"
    # one write: what another program adds meanwhile comes before or after it, and half a line of a kill ends there
    with history_path(path).open("ab") as opened:
        opened.write(f"\n{line}".encode())


def _lines(path: Path) -> list[str]:
    file = history_path(path)
    if not file.exists():
        return []
    content = read_content(file, "the history of a case", most=LARGEST_FILE)
    return [line for line in content.decode(errors="replace").split("\n") if line.strip()]


def _entry(line: str) -> dict[str, str]:
    entry: Any = parsed_json(line.encode(), "it")
    if not isinstance(entry, dict) or not all(isinstance(entry.get(key), str) for key in ("time", "case")):
        raise InputError("found no line of it")
    return entry
