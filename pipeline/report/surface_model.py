"""The coloured surface of a dataset, reduced to what a page can hold and a browser turns smoothly."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..dataset.layout import MODEL_FILES
from ..dataset.model_file import read_model
from ..surface.decimation import cluster_vertices
from ..surface.mesh import TriangleMesh
from .thumbnails import base64_text

MODEL = MODEL_FILES[0]
MOST_VERTICES = 30_000
"""About 0.9 MB of text; with 65 536 or more, indices would need twice the bytes."""


@dataclass(frozen=True)
class ColouredSurface:
    """A surface in the model frame, mm, and ``(V, 3)`` uint8 RGB."""

    mesh: TriangleMesh
    colours: np.ndarray

    def reduced(self, most_vertices: int = MOST_VERTICES) -> "ColouredSurface":
        """At most this many vertices, by merging; the surface itself if it has no more."""
        mesh, colours = self.mesh, self.colours.astype(np.float64)
        if len(mesh.vertices) <= most_vertices:
            return self
        # as if every vertex stood for a square
        cell_mm = float(np.sqrt(np.linalg.norm(mesh.face_cross, axis=1).sum() / 2 / most_vertices))
        merged, mean = cluster_vertices(mesh, cell_mm, colours)
        while merged is not mesh and len(merged.vertices) > most_vertices:
            cell_mm *= 1.1
            merged, mean = cluster_vertices(mesh, cell_mm, colours)
        return ColouredSurface(merged, np.rint(colours if mean is None else mean).astype(np.uint8))

    def packed(self) -> dict[str, object]:
        """For the page: vertices as 16-bit steps within the box, colours and triangles, as base64."""
        low, high = self.mesh.bounds
        step = np.maximum(high - low, 1e-9) / 65535
        steps = np.rint((self.mesh.vertices - low) / step).astype("<u2")
        index = "<u2" if len(self.mesh.vertices) <= 65536 else "<u4"
        return {
            "low": low.tolist(),
            "step": step.tolist(),
            "positions": base64_text(steps.tobytes()),
            "colours": base64_text(np.ascontiguousarray(self.colours, np.uint8).tobytes()),
            "triangles": base64_text(self.mesh.faces.astype(index).tobytes()),
            "wide": index == "<u4",
        }


def read_surface(root: Path) -> ColouredSurface:
    """Read the model of a dataset.

    Raises
    ------
    InputError
        Missing, or not the model that a dataset has.
    """
    mesh, colours = read_model(root, MODEL)
    return ColouredSurface(mesh, np.full((len(mesh.vertices), 3), 200, np.uint8) if colours is None else colours)
