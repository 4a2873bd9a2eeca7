"""Which run a dataset belongs to: its description in ``dataset.json``, and one hash of it in every record.

The description holds everything that the content depends on. The number of views is in it too, and the hash of their
poses if these were listed, but they do not belong to the identity: a dataset that grows stays the same one.
"""

import hashlib
import json
from collections.abc import Mapping

import numpy as np

from ..surface.mesh import TriangleMesh
from .differences import (
    GROWING,
)


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
