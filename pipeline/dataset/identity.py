"""Which run a dataset belongs to: its description in ``dataset.json``, and one hash of it in every record.

The description holds everything that the content depends on. The number of views is in it too, but does not belong to
the identity: a dataset that grows stays the same one.
"""

import hashlib
import json
from collections.abc import Iterable, Mapping
from pathlib import Path

import numpy as np

from ..errors import RunError
from ..surface.mesh import TriangleMesh
from .layout import FORMAT, RECORD

COUNT = "count"
"""The one key of the description that may change."""


def identity_of(description: Mapping[str, object]) -> str:
    """The identity of a dataset: SHA-256 of the canonical JSON of its description without the number of views."""
    content = {key: value for key, value in description.items() if key != COUNT}
    return hashlib.sha256(json.dumps(content, sort_keys=True, separators=(",", ":")).encode()).hexdigest()


def geometry_hash(mesh: TriangleMesh) -> str:
    """SHA-256 of a surface: its vertices as float32, as the model is written, and then its faces as int32.

    It is taken before the surface is rendered. If the frame sees the back of the surface, the faces in ``models/`` are
    the flipped ones (:meth:`.TriangleMesh.flipped`).
    """
    content = hashlib.sha256(np.ascontiguousarray(mesh.vertices, "<f4").tobytes())
    content.update(np.ascontiguousarray(mesh.faces, "<i4").tobytes())
    return content.hexdigest()


def description_bytes(description: Mapping[str, object]) -> bytes:
    """The content of ``dataset.json``."""
    return (json.dumps(description, indent=2) + "\n").encode()


def check_description(root: Path, description: Mapping[str, object]) -> None:
    """Check that a dataset on disk belongs to a run, and has no more views than the run wants.

    Parameters
    ----------
    root
        The dataset's folder; nothing is checked if it has no ``dataset.json``.
    description
        Everything that the run's content depends on; JSON types only.

    Raises
    ------
    RunError
        The two differ, the run wants fewer views, or ``dataset.json`` is not what it should be. The message says what
        differs.
    OSError
        The file cannot be read.
    """
    record = root / RECORD
    try:
        content = record.read_bytes()
    except FileNotFoundError:
        return
    if is_cut_off(content, description_bytes(description)):
        return
    try:
        existing = json.loads(content)
    except (ValueError, RecursionError):
        raise RunError(
            f"{record}: expected the description of a dataset, found no JSON; choose another folder (--out)"
        ) from None
    if not isinstance(existing, dict):
        raise RunError(
            f"{record}: expected the description of a dataset, found {_short(existing)}; choose another folder (--out)"
        )
    if existing.get("format") != FORMAT == description.get("format"):
        raise RunError(
            f"{root}: expected a dataset of the format {FORMAT!r}, found {_short(existing.get('format'))} of another "
            "version of OneFrame; use that version, or choose another folder (--out)"
        )
    differences = described_differences(existing, description)
    if differences:
        raise RunError(
            f"{root}: the folder holds the dataset of another run ({_first(differences)}); "
            "undo the change to resume it, or choose another folder (--out)"
        )
    had, wanted = existing.get(COUNT), description[COUNT]
    if not isinstance(had, int) or not isinstance(wanted, int) or had > wanted:
        raise RunError(
            f"{root}: the folder holds a dataset of {_short(had)} views, and {wanted} are wanted: a dataset may grow, "
            "but not shrink; set the number of views to that or more, or choose another folder (--out)"
        )


def is_cut_off(content: bytes, whole: bytes) -> bool:
    """Whether a file is what a loss of power may leave of another: its beginning, and zeros for the rest."""
    return len(content) <= len(whole) and content != whole and whole.startswith(content.rstrip(b"\0"))


def described_differences(old: Mapping[str, object], new: Mapping[str, object]) -> list[str]:
    """What differs between two descriptions, as clauses; changed files first, as other differences may follow."""
    new = json.loads(json.dumps(new))
    found = _differences({**old, COUNT: None}, {**new, COUNT: None}, "")
    return sorted(found, key=lambda text: (not text.startswith("the file"), text))


def other_description(root: Path, identity: str) -> Mapping[str, object] | None:
    """A description of this identity that was kept beside ``dataset.json``, such as by ``cp --backup``; or ``None``."""
    for path in sorted(root.glob("dataset*")):
        try:
            content = json.loads(path.read_bytes())
        except (OSError, ValueError, RecursionError):
            continue
        if isinstance(content, dict) and identity_of(content) == identity:
            return content
    return None


def _first(differences: Iterable[str]) -> str:
    clauses = [*differences]
    return "; ".join(clauses[:4]) + (f" and {len(clauses) - 4} more" if len(clauses) > 4 else "")


def _differences(old: object, new: object, name: str) -> list[str]:
    if isinstance(old, dict) and isinstance(new, dict):
        keys = old.keys() | new.keys()
        return [
            text for key in keys for text in _differences(old.get(key), new.get(key), f"{name}.{key}" if name else key)
        ]
    if old == new:
        return []
    if name.startswith("inputs_sha256."):
        return [f"the file of the {name.removeprefix('inputs_sha256.')} has changed"]
    if name == "options.views":
        return [f"poses along a trajectory depend on the number of views, which was {_short(old)}, is {_short(new)}"]
    return [f"{name} was {_short(old)}, is {_short(new)}"]


def _short(value: object) -> str:
    text = json.dumps(value)
    return text if len(text) <= 40 else text[:37] + "..."
