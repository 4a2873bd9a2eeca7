"""Which run a dataset belongs to: its description in ``dataset.json``, and one hash of it in every record.

The description holds everything that the content depends on. The number of views is in it too, but does not belong to
the identity: a dataset that grows stays the same one.
"""

import hashlib
import json
from collections.abc import Mapping

import numpy as np

from ..surface.mesh import TriangleMesh

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
