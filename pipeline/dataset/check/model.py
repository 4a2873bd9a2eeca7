"""The model of a dataset: its geometry's hash, its origin, and ``models_info.json``."""

from pathlib import Path

import numpy as np

from ...errors import InputError
from ...surface.mesh import TriangleMesh, diameter
from ..dataset_file import Description
from ..identity import geometry_hash
from ..layout import MODEL_FILES, OBJECT_ID
from ..model_file import read_model
from .comparison import read_table, require_equal
from .findings import Findings

MODEL, MODELS_INFO, _, REDUCED_INFO = MODEL_FILES


def check_model(root: Path, description: Description, findings: Findings) -> TriangleMesh | None:
    """Check the models and what is said of them; the mesh, or ``None`` if it cannot be read."""
    mesh = None
    with findings.collecting("damaged files"):
        mesh, _ = read_model(root, MODEL)
        # a surface whose back the frame sees is written with its faces turned
        hashes = {geometry_hash(side) for side in (mesh, mesh.flipped())}
        if description.content.get("geometry_sha256") not in hashes:
            raise InputError(f"{MODEL}: its vertices and faces do not have the geometry_sha256 of dataset.json")
        off = float(np.abs(mesh.vertices.mean(axis=0)).max())
        if off > 2e-6 * mesh.radius:
            raise InputError(f"{MODEL}: expected the mean of the vertices at the origin, it is {off:.2g} mm off")
    if mesh is None:
        return None
    for name in (MODELS_INFO, REDUCED_INFO):
        with findings.collecting("tables that disagree"):
            # of the model whose coordinates were rounded
            relative = 2e-6 * max(mesh.radius, 1.0)
            require_equal(read_table(root, name), {str(OBJECT_ID): _info(mesh)}, name, relative=relative)
    return mesh


def _info(mesh: TriangleMesh) -> dict[str, object]:
    low, high = mesh.bounds
    expected: dict[str, object] = {"diameter": diameter(mesh.vertices), "box_centre_mm": ((low + high) / 2).tolist()}
    for name, values in (("min", low), ("size", high - low)):
        expected |= {f"{name}_{axis}": float(value) for axis, value in zip("xyz", values, strict=True)}
    return expected
