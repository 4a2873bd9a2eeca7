"""How the descriptions of two datasets differ: as data, and in the words of the command line."""

import json
from collections.abc import Mapping
from dataclasses import dataclass

COUNT, POSES_HASH, DEPTH_SCALE = "count", "poses_sha256", "depth_scale"
GROWING = (COUNT, POSES_HASH)
"""The keys of the description that may change: a dataset that grows stays the same one."""
LISTED = "poses"
"""The key of listed poses as such, and followed by a dot and a number that of one of them."""
INPUTS = "inputs_sha256."
"""The keys of the hashes of input files begin with it."""


@dataclass(frozen=True)
class Difference:
    """A value that differs between two descriptions.

    Attributes
    ----------
    key
        Its keys, joined by dots, such as ``options.seed``.
    found, asked
        The value on disk and that of the run; ``None`` where there is none.
    """

    key: str
    found: object
    asked: object

    @property
    def of_input(self) -> str | None:
        """Name of the input file that has changed, such as ``frame``; ``None`` if it is no file."""
        return self.key.removeprefix(INPUTS) if self.key.startswith(INPUTS) else None


def differences(found: Mapping[str, object], asked: Mapping[str, object]) -> list[Difference]:
    """What differs between a description on disk and a run's, by key; changed files first, as others may follow.

    What changes when a dataset grows is not among it.
    """
    asked = json.loads(json.dumps(asked))
    without = dict.fromkeys(GROWING)
    changes = _differences({**found, **without}, {**asked, **without}, "")
    return sorted(changes, key=lambda difference: (difference.of_input is None, difference.key))


def described(changes: list[Difference]) -> list[str]:
    """The differences as clauses: files and versions first, as others may follow from them."""
    return sorted(map(_clause, changes), key=lambda text: (not text.startswith(("the file", "versions.")), text))


def short(value: object) -> str:
    """A value of a description in a message."""
    text = json.dumps(value)
    return text if len(text) <= 40 else text[:37] + "..."


def _differences(found: object, asked: object, name: str) -> list[Difference]:
    if isinstance(found, dict) and isinstance(asked, dict):
        return [
            difference
            for key in found.keys() | asked.keys()
            for difference in _differences(found.get(key), asked.get(key), f"{name}.{key}" if name else key)
        ]
    return [] if found == asked else [Difference(name, found, asked)]


def _clause(change: Difference) -> str:
    was, now = short(change.found), short(change.asked)
    if change.of_input is not None:
        return f"the file of the {change.of_input} has changed"
    if change.key.partition(".")[0] == LISTED:
        which = change.key.partition(".")[2]
        changed = f"pose {which} (counted from 0)" if which else "a pose"
        return f"{changed} of the list has changed, which may only get longer at its end"
    if change.key == "options.views":
        return f"poses along a trajectory depend on the number of views, which was {was}, is {now}"
    if change.key == DEPTH_SCALE and change.asked is None:
        return "its poses were listed (--poses), now they are drawn"
    if change.key == DEPTH_SCALE and change.found is None:
        return "its poses were drawn, now they are listed (--poses)"
    if change.key == DEPTH_SCALE:
        return f"the listed poses reach to another depth: the scale of the depth images was {was} mm, is {now} mm"
    return f"{change.key} was {was}, is {now}"
