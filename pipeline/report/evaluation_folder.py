"""The folder of an evaluation: rows and summaries; pictures and charts, as far as they are there."""

import json
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
LISTS = ("cases", "methods", "rows", "summary", "distribution", "bound", "pictures")
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
        Which pictures cannot be used.
    """

    root: Path
    content: Mapping[str, Any]
    problems: list[str]

    def rows(self, name: str) -> list[dict[str, Any]]:
        """The entries of a list."""
        return list(self.content.get(name, []))

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


def open_evaluation(root: Path) -> EvaluationFolder:
    """Read the description of an evaluation.

    Raises
    ------
    InputError
        Not JSON, damaged, or of another format.
    """
    content = parsed_json(read_content(root / EVALUATION, "the description of an evaluation"), EVALUATION)
    if not isinstance(content, dict) or content.get("format") != FORMAT:
        found = json.dumps(content.get("format") if isinstance(content, dict) else None)[:60]
        raise InputError(
            f"{root / EVALUATION}: expected the format {FORMAT!r}, found {found}; use the version of OneFrame that "
            "made it"
        )
    try:
        kinds = dict.fromkeys(LISTS, list) | {"conditions": dict, "scores": dict, "charts": list}
        if not all(isinstance(content.get(name, kind()), kind) for name, kind in kinds.items()):
            raise ValueError("other kinds of values")
        if not all(isinstance(entry, dict) for name in LISTS for entry in content.get(name, [])):
            raise ValueError("a list of something else than tables")
        json.dumps(content, allow_nan=False)
    except ValueError as error:
        raise InputError(f"{root / EVALUATION}: expected {FORMAT!r}, found {error}; evaluate again") from None
    return EvaluationFolder(root, content, [])
