"""Scores of finished views in the folder of an evaluation: a killed one goes on where it was.

A file of JSON lines. The first one says what is evaluated (:func:`identity_of`); the scores of another evaluation are
dropped. Each further one is a view, written when its scores are known. The last may be torn. Numbers are
those of the views to the last bit, so the results of a resumed evaluation are, too.
"""

import hashlib
import json
from collections.abc import Iterable, Mapping
from contextlib import suppress
from pathlib import Path

import numpy as np

from ..files.content import read_content
from ..files.outputs import write_output, writing

FINISHED = ".finished.jsonl"
"""Name of the file; its folder may hold it, as all hidden ones."""
Key = tuple[str, str, int]
"""Case, method (or :data:`BOUND`), and number of the photograph."""
BOUND = "limit"


def identity_of(settings: Mapping[str, object], files: Iterable[Path]) -> str:
    """What all scores depend on: settings of JSON types, and the contents of files, in their order.

    Raises
    ------
    InputError
        A file cannot be read.
    """
    hashes = [hashlib.sha256(read_content(path, "an input of the evaluation")).hexdigest() for path in files]
    return hashlib.sha256(json.dumps([settings, hashes], sort_keys=True).encode()).hexdigest()


class FinishedScores:
    """The scores of views by their key, those of an interrupted evaluation among them."""

    def __init__(self, folder: Path, identity: str) -> None:
        """Read the file of a folder, and write it anew without what is torn.

        Raises
        ------
        RunError
            The file cannot be written.
        """
        self._path, first = folder / FINISHED, json.dumps(identity)
        self._known: dict[Key, dict] = {}
        lines = self._path.read_text(errors="replace").split("\n") if self._path.exists() else []
        if lines[:1] == [first]:
            # what follows the last newline is torn, or nothing; the view of a damaged line is scored again
            for line in lines[1:-1]:
                with suppress(ValueError, KeyError, TypeError):
                    entry = json.loads(line)
                    self._known[tuple(entry["view"])] = entry
        whole = [first, *(json.dumps(entry) for entry in self._known.values())]
        write_output(self._path, "".join(f"{line}\n" for line in whole).encode())

    def __contains__(self, key: Key) -> bool:
        return key in self._known

    def scores(self, key: Key) -> dict[str, float]:
        """Scores of a finished view."""
        return self._known[key]["scores"]

    def features(self, key: Key) -> tuple[np.ndarray, np.ndarray] | None:
        """Features of the photograph and of the view, float32, if there are any."""
        found = self._known[key].get("features")
        return None if found is None else (np.array(found[0], np.float32), np.array(found[1], np.float32))

    def add(self, key: Key, scores: Mapping[str, float], features: tuple[np.ndarray, np.ndarray] | None = None) -> None:
        """Keep the scores of a view.

        Raises
        ------
        RunError
            The file cannot be written.
        """
        entry: dict[str, object] = {"view": key, "scores": scores}
        if features is not None:
            entry["features"] = [each.tolist() for each in features]
        line = json.dumps(entry)
        # as it is read again
        self._known[key] = json.loads(line)
        with writing(self._path), open(self._path, "a") as file:
            file.write(line + "\n")

    def remove(self) -> None:
        """Remove the file, once the evaluation is written.

        Raises
        ------
        RunError
            It cannot be removed.
        """
        with writing(self._path):
            self._path.unlink(missing_ok=True)
