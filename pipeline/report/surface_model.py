"""The coloured surface of a dataset, reduced to what a page can hold and a browser turns smoothly."""

from pathlib import Path

import numpy as np

from ..dataset.layout import MODEL_FILES
from ..dataset.model_file import read_model
from ..surface.decimation import reduced_mesh
from ..surface.mesh import TriangleMesh
from .thumbnails import base64_text

MODEL = MODEL_FILES[0]
MOST_VERTICES = 30_000
"""About 0.9 MB of text; with 65 536 or more, indices would need twice the bytes."""


def read_surface(root: Path) -> tuple[TriangleMesh, np.ndarray]:
    """Read the model of a dataset: the surface in the model frame, mm, and ``(V, 3)`` uint8 RGB.

    Raises
    ------
    InputError
        Missing, or not the model that a dataset has.
    """
    mesh, colours = read_model(root, MODEL)
    return mesh, np.full((len(mesh.vertices), 3), 200, np.uint8) if colours is None else colours


def packed_surface(mesh: TriangleMesh, colours: np.ndarray) -> dict[str, object]:
    """For the page: reduced, vertices as 16-bit steps within the box, colours and triangles, as base64."""
    mesh, mean = reduced_mesh(mesh, MOST_VERTICES, colours.astype(np.float64))
    low, high = mesh.bounds
    step = np.maximum(high - low, 1e-9) / 65535
    steps = np.rint((mesh.vertices - low) / step).astype("<u2")
    index = "<u2" if len(mesh.vertices) <= 65536 else "<u4"
    return {
        "low": low.tolist(),
        "step": step.tolist(),
        "positions": base64_text(steps.tobytes()),
        "colours": base64_text(np.rint(mean).astype(np.uint8).tobytes()),  # type: ignore[arg-type]  # as it is given
        "triangles": base64_text(mesh.faces.astype(index).tobytes()),
        "wide": index == "<u4",
    }
