"""The models of a dataset, read as they are written."""

import re
from pathlib import Path

import numpy as np

from ..errors import InputError
from ..files.content import read_content
from ..surface.mesh import LARGEST_COORDINATE, TriangleMesh

_HEADER = re.compile(
    rb"ply\nformat binary_little_endian 1\.0\n(?:comment [^\n]*\n)*element vertex ([0-9]{1,9})\n"
    rb"property float x\nproperty float y\nproperty float z\n"
    rb"property float nx\nproperty float ny\nproperty float nz\n"
    rb"(property uchar red\nproperty uchar green\nproperty uchar blue\n)?"
    rb"element face ([0-9]{1,9})\nproperty list uchar int vertex_indices\nend_header\n"
)
_FACE = np.dtype([("count", "u1"), ("corners", "<i4", 3)])


def read_model(root: Path, name: str) -> TriangleMesh:
    """The very vertices and faces of a model, model frame, mm, by its name relative to the dataset's folder."""
    data = read_content(root / name, "a model of the dataset", name)
    header = _HEADER.match(data)
    if header is None:
        raise InputError(f"{name}: expected a model as datasets have it, found another header; copy it again")
    vertex = np.dtype([("xyz", "<f4", 3), ("normal", "<f4", 3), *([("rgb", "u1", 3)] if header[2] else [])])
    vertices, faces = int(header[1]), int(header[3])
    expected = header.end() + vertices * vertex.itemsize + faces * _FACE.itemsize
    if len(data) != expected or not vertices or not faces:
        raise InputError(
            f"{name}: expected {expected} bytes for {vertices} vertices and {faces} faces, found {len(data)}; copy it "
            "again"
        )
    table = np.frombuffer(data, vertex, vertices, header.end())
    triangles = np.frombuffer(data, _FACE, faces, header.end() + table.nbytes)
    corners = triangles["corners"]
    sound = (triangles["count"] == 3).all() and corners.min() >= 0 and corners.max() < vertices
    if not sound or not (np.abs(table["xyz"]) < LARGEST_COORDINATE).all():
        raise InputError(f"{name}: expected triangles with coordinates in mm, found others; the file is damaged")
    return TriangleMesh(table["xyz"].astype(np.float64), np.ascontiguousarray(corners, np.int32))
