"""The coloured surface of a dataset, reduced to what a page can hold and a browser turns smoothly."""

import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..dataset.layout import MODEL_FILES
from ..errors import InputError
from ..files.content import read_content
from ..surface.decimation import cluster_vertices
from ..surface.mesh import LARGEST_COORDINATE, TriangleMesh
from .thumbnails import base64_text

MODEL = MODEL_FILES[0]
MOST_VERTICES = 30_000
"""About 0.9 MB of text; with 65 536 or more, indices would need twice the bytes."""

_HEADER = re.compile(
    rb"ply\nformat binary_little_endian 1\.0\n(?:comment [^\n]*\n)*element vertex ([0-9]{1,9})\n"
    rb"property float x\nproperty float y\nproperty float z\n"
    rb"property float nx\nproperty float ny\nproperty float nz\n"
    rb"property uchar red\nproperty uchar green\nproperty uchar blue\n"
    rb"element face ([0-9]{1,9})\nproperty list uchar int vertex_indices\nend_header\n"
)
_VERTEX = np.dtype([("xyz", "<f4", 3), ("normal", "<f4", 3), ("rgb", "u1", 3)])
_FACE = np.dtype([("count", "u1"), ("corners", "<i4", 3)])


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
    data = read_content(root / MODEL, "the model of a dataset", MODEL)
    header = _HEADER.match(data)
    if header is None:
        raise InputError(f"{MODEL}: expected a coloured model as datasets have it, found another header")
    vertices, faces = int(header[1]), int(header[2])
    if len(data) != header.end() + vertices * _VERTEX.itemsize + faces * _FACE.itemsize:
        raise InputError(f"{MODEL}: expected {vertices} vertices and {faces} faces, the file has another size")
    table = np.frombuffer(data, _VERTEX, vertices, header.end())
    triangles = np.frombuffer(data, _FACE, faces, header.end() + table.nbytes)
    corners = triangles["corners"]
    sound = len(triangles) and (triangles["count"] == 3).all() and corners.min() >= 0 and corners.max() < vertices
    if not sound or not (np.abs(table["xyz"]) < LARGEST_COORDINATE).all():
        raise InputError(f"{MODEL}: expected triangles with coordinates in mm, found others; the file is damaged")
    mesh = TriangleMesh(table["xyz"].astype(np.float64), np.ascontiguousarray(corners, np.int32))
    return ColouredSurface(mesh, np.ascontiguousarray(table["rgb"]))
