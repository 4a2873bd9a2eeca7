"""Which run a dataset belongs to: its description in ``dataset.json``, one hash of it in every record, and differences.

The description holds everything that the content depends on. The number of views is in it too, and the hash of their
poses if these were listed, but they do not belong to the identity: a dataset that grows stays the same one.
"""

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from ..surface.mesh import TriangleMesh

COUNT, POSES_HASH, DEPTH_SCALE = "count", "poses_sha256", "depth_scale"
GROWING = (COUNT, POSES_HASH)
"""The keys of the description that may change: a dataset that grows stays the same one."""
LISTED = "poses"
"""The key of listed poses as such."""
INPUTS = "inputs_sha256."
"""The keys of the hashes of input files begin with it."""

_PARTS = {
    "frame.cam_from_model": "pose",
    "frame.distortion": "distortion",
    "geometry_sha256": "geometry of the surface",
    "mesh_from_model": "geometry of the surface",
}
"""Keys whose values say nothing to people."""


def identity_of(description: Mapping[str, object]) -> str:
    """The identity of a dataset: SHA-256 of the canonical JSON of its description without what grows."""
    content = {key: value for key, value in description.items() if key not in GROWING}
    return hashlib.sha256(json.dumps(content, sort_keys=True, separators=(",", ":")).encode()).hexdigest()


def geometry_hash(mesh: TriangleMesh) -> str:
    """SHA-256 of a surface: its vertices as float32, as the model is written, and then its faces as int32.

    It is taken before the surface is rendered. If the frame sees the back of the surface, the faces in ``models/`` are
    the flipped ones (:meth:`.TriangleMesh.flipped`).
    """
    content = hashlib.sha256(np.ascontiguousarray(mesh.vertices, "<f4").tobytes())
    content.update(np.ascontiguousarray(mesh.faces, "<i4").tobytes())
    return content.hexdigest()


def poses_hash(poses: np.ndarray) -> str:
    """SHA-256 of listed poses, ``(N, 4, 4)`` cam_from_model, mm: of their upper three rows as float64."""
    return hashlib.sha256(np.ascontiguousarray(poses[:, :3], "<f8").tobytes()).hexdigest()


def description_bytes(description: Mapping[str, object]) -> bytes:
    """The content of ``dataset.json``."""
    return (json.dumps(description, indent=2) + "\n").encode()


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
    changes = changed_values({**found, **without}, {**asked, **without})
    return sorted(changes, key=lambda difference: (difference.of_input is None, difference.key))


def described(changes: list[Difference]) -> list[str]:
    """The differences as clauses, each once: files and versions first, as others may follow from them."""
    return sorted({*map(_clause, changes)}, key=lambda text: (not text.startswith(("the file", "versions.")), text))


def short(value: object) -> str:
    """A value of a description in a message."""
    text = json.dumps(value)
    return text if len(text) <= 40 else text[:37] + "..."


def changed_values(found: object, asked: object, name: str = "") -> list[Difference]:
    """What differs between two JSON values; lists are compared as a whole."""
    if isinstance(found, dict) and isinstance(asked, dict):
        return [
            difference
            for key in sorted(found.keys() | asked.keys())
            for difference in changed_values(found.get(key), asked.get(key), f"{name}.{key}" if name else key)
        ]
    return [] if found == asked else [Difference(name, found, asked)]


def _clause(change: Difference) -> str:
    was, now = short(change.found), short(change.asked)
    if change.of_input is not None:
        return f"the file of the {change.of_input} has changed"
    group, _, which = change.key.partition(".")
    if change.key in _PARTS:
        return f"the {_PARTS[change.key]} has changed"
    if group in ("camera", "frame"):
        return f"{which} of the camera was {was}, is {now}"
    if group == LISTED:
        return "a pose of the list has changed, which may only get longer at its end"
    if change.key == "options.views":
        return f"poses along a trajectory depend on the number of views, which was {was}, is {now}"
    if change.key == DEPTH_SCALE:
        return f"listed poses (--poses) set the scale of the depth images, which was {was} mm, is {now} mm; null: drawn"
    return f"{change.key} was {was}, is {now}"
