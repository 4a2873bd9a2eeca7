"""The folder of an evaluation, read tolerantly: rows, summaries, pictures and charts, as far as they are there."""

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ..dataset.check.findings import printable
from ..errors import InputError
from ..files.content import read_content
from ..files.tables import parsed_json

EVALUATION = "evaluation.json"
FORMAT = "oneframe evaluation 1"
FIGURES = (("figure.png", "Real frames and what the methods make of them"), ("pairs.png", "Pairs of novel poses"))
"""Pictures beside the description, and what they show."""


@dataclass(frozen=True)
class EvaluationFolder:
    """An evaluation on disk.

    Attributes
    ----------
    root
        Its folder.
    content
        ``evaluation.json``.
    problems
        What of it cannot be used.
    """

    root: Path
    content: Mapping[str, Any]
    problems: list[str]

    def rows(self, name: str) -> list[dict[str, Any]]:
        """The entries of a list that are tables; others are reported once."""
        value = self.content.get(name, [])
        found = [entry for entry in value if isinstance(entry, dict)] if isinstance(value, list) else []
        if not isinstance(value, list) or len(found) < len(value):
            self.problems.append(f"{EVALUATION}: {name}: expected a list of tables, found something else in it")
        return [{str(key): plain_value(cell) for key, cell in entry.items()} for entry in found]

    def table(self, name: str) -> Mapping[str, Any]:
        """A table, empty if it is none."""
        value = self.content.get(name)
        return value if isinstance(value, dict) else {}

    def names(self, name: str) -> list[str]:
        """The texts of a list."""
        value = self.content.get(name)
        return [entry for entry in value if isinstance(entry, str)] if isinstance(value, list) else []

    def file(self, name: object) -> bytes | None:
        """The content of a file in the folder; ``None``, with an entry in ``problems``, if it cannot be had."""
        if not isinstance(name, str) or not name:
            return None
        try:
            path = (self.root / name).resolve()
            if not path.is_relative_to(self.root.resolve()):
                raise InputError(f"{name}: expected a file in the folder of the evaluation, found one elsewhere")
            return read_content(path, "a picture of the evaluation", name)
        except (InputError, OSError, ValueError, RuntimeError) as error:
            self.problems.append(printable(str(error).replace(f"{self.root.resolve()}/", "")))
            return None


def plain_value(cell: object) -> object:
    """A cell for the page: text, a finite number, a truth value or nothing."""
    if cell is None or isinstance(cell, bool | str):
        return cell
    if isinstance(cell, int | float):
        return cell if math.isfinite(cell) else None
    return json.dumps(cell)


def open_evaluation(root: Path) -> EvaluationFolder:
    """Read the description of an evaluation.

    Raises
    ------
    InputError
        Not JSON, or of another format.
    """
    content = parsed_json(read_content(root / EVALUATION, "the description of an evaluation"), EVALUATION)
    if not isinstance(content, dict) or content.get("format") != FORMAT:
        found = json.dumps(content.get("format") if isinstance(content, dict) else None)[:60]
        raise InputError(
            f"{root / EVALUATION}: expected the format {FORMAT!r}, found {found}; use the version of OneFrame that "
            "made it"
        )
    return EvaluationFolder(root, content, [])
