"""The model of a dataset: its file, its geometry's hash, its normals and ``models_info.json``.

The file is read here with the layout that the format promises, and the normals are computed here from the geometry.
"""

import hashlib
import re
from pathlib import Path

import numpy as np

from ...surface.mesh import LARGEST_COORDINATE, TriangleMesh, diameter
from ..layout import OBJECT_ID
from .files import DamagedFile, mapping, numbers, opened, read_object, require_keys
from .findings import Findings

MODEL, MODELS_INFO = f"models/obj_{OBJECT_ID:06d}.ply", "models/models_info.json"
LARGEST_MODEL = 1 << 31
"""Bytes; ten million vertices have less than half of it."""
ROUNDING = 2.0**-24
"""Largest relative error of a number stored in single precision."""

_HEADER = re.compile(
    rb"ply\nformat binary_little_endian 1\.0\n(?:comment [^\n]*\n)*"
    rb"element vertex ([0-9]{1,10})\n"
    rb"property float x\nproperty float y\nproperty float z\n"
    rb"property float nx\nproperty float ny\nproperty float nz\n"
    rb"property uchar red\nproperty uchar green\nproperty uchar blue\n"
    rb"element face ([0-9]{1,10})\nproperty list uchar int vertex_indices\nend_header\n"
)
_VERTEX = np.dtype([("xyz", "<f4", 3), ("normal", "<f4", 3), ("rgb", "u1", 3)])
_FACE = np.dtype([("count", "u1"), ("corners", "<i4", 3)])


def check_model(root: Path, missing: set[str], geometry_sha256: str, findings: Findings) -> TriangleMesh | None:
    """Check the model's files; return the mesh, or ``None`` if it is missing or unreadable."""
    if MODEL in missing:
        return None
    try:
        vertices, faces = _read_model(root)
    except DamagedFile as damage:
        findings.add("damaged files", damage)
        return None
    mesh = TriangleMesh(vertices["xyz"].astype(np.float64), np.ascontiguousarray(faces, np.int32))
    for check in (
        lambda: _check_geometry(vertices["xyz"], faces, geometry_sha256),
        lambda: _check_centre(mesh),
        lambda: _check_normals(mesh, vertices["normal"]),
    ):
        try:
            check()
        except DamagedFile as damage:
            findings.add("damaged files", damage)
    if MODELS_INFO not in missing:
        try:
            _check_info(root, mesh)
        except DamagedFile as damage:
            findings.add("tables that disagree", damage)
    return mesh


def _read_model(root: Path) -> tuple[np.ndarray, np.ndarray]:
    """``(V,)`` records of vertices and ``(F, 3)`` faces."""
    with opened(root, MODEL) as (stream, size):
        start = stream.read(4096)
        header = _HEADER.match(start)
        if header is None:
            raise DamagedFile(
                f"{MODEL}: expected a binary PLY with positions, normals and colours of vertices, found another header"
            )
        vertex_count, face_count = (int(count) for count in header.groups())
        expected = header.end() + vertex_count * _VERTEX.itemsize + face_count * _FACE.itemsize
        if size != expected or not vertex_count or not face_count:
            raise DamagedFile(
                f"{MODEL}: expected {expected} bytes for {vertex_count} vertices and {face_count} faces, found {size}"
            )
        if size > LARGEST_MODEL:
            raise DamagedFile(f"{MODEL}: expected at most {LARGEST_MODEL} bytes, found {size}")
        stream.seek(header.end())
        data = stream.read(expected - header.end())
    if len(data) != expected - header.end():
        raise DamagedFile(f"{MODEL}: the file is changing")
    vertices = np.frombuffer(data, _VERTEX, vertex_count)
    faces = np.frombuffer(data, _FACE, face_count, vertices.nbytes)
    if not (np.abs(vertices["xyz"]) < LARGEST_COORDINATE).all():
        raise DamagedFile(f"{MODEL}: expected coordinates in mm, found NaN, infinity or larger than 1000 km")
    corners = faces["corners"]
    if (faces["count"] != 3).any() or corners.min() < 0 or corners.max() >= vertex_count:
        raise DamagedFile(f"{MODEL}: expected triangles of vertices 0 to {vertex_count - 1}, found others")
    return vertices, corners


def _check_geometry(vertices: np.ndarray, faces: np.ndarray, expected: str) -> None:
    # the hash is that of the surface as given; a surface whose back the frame sees is written with its faces turned
    for turned in (faces, faces[:, ::-1]):
        digest = hashlib.sha256(np.ascontiguousarray(vertices).tobytes())
        digest.update(np.ascontiguousarray(turned).tobytes())
        if digest.hexdigest() == expected:
            return
    raise DamagedFile(f"{MODEL}: its vertices and faces do not have the geometry_sha256 of dataset.json")


def _check_centre(mesh: TriangleMesh) -> None:
    off = float(np.abs(mesh.vertices.mean(axis=0)).max())
    if off > 2e-6 * mesh.radius:
        raise DamagedFile(f"{MODEL}: expected the mean of the vertices at the origin, it is {off:.2g} mm off")


def _check_normals(mesh: TriangleMesh, found: np.ndarray) -> None:
    """Compare with the sum of the faces' area vectors, as far as coordinates in single precision determine it."""
    a, b, c = (mesh.vertices[mesh.faces[:, corner]] for corner in range(3))
    area = np.cross(b - a, c - a)
    around = np.linalg.norm(b - a, axis=1) + np.linalg.norm(c - b, axis=1) + np.linalg.norm(a - c, axis=1)
    total, reach = np.zeros_like(mesh.vertices), np.zeros(len(mesh.vertices))
    for corner in range(3):
        np.add.at(total, mesh.faces[:, corner], area)
        np.add.at(reach, mesh.faces[:, corner], around)
    length = np.linalg.norm(total, axis=1)
    # each edge is off by at most twice the rounding of a coordinate along each axis
    off_by = 4 * np.sqrt(3) * ROUNDING * np.abs(mesh.vertices).max() * reach
    known = length > 10 * off_by
    tolerance = 2 * off_by[known] / length[known] + 1e-6
    expected = total[known] / length[known, None]
    with np.errstate(over="ignore", invalid="ignore"):
        wrong = ~(np.linalg.norm(found[known] - expected, axis=1) <= tolerance)
    if wrong.any():
        raise DamagedFile(
            f"{MODEL}: {int(wrong.sum())} of {len(wrong)} normals are not those of the surface "
            f"(first: vertex {int(np.flatnonzero(known)[np.argmax(wrong)])})"
        )


def _check_info(root: Path, mesh: TriangleMesh) -> None:
    low, high = mesh.bounds
    expected = {"diameter": diameter(mesh.vertices)}
    expected |= {f"min_{axis}": value for axis, value in zip("xyz", low, strict=True)}
    expected |= {f"size_{axis}": value for axis, value in zip("xyz", high - low, strict=True)}
    content = read_object(root, MODELS_INFO)
    require_keys(content, {str(OBJECT_ID)}, MODELS_INFO)
    info = mapping(content, str(OBJECT_ID), MODELS_INFO)
    require_keys(info, set(expected), MODELS_INFO)
    for name, value in expected.items():
        if abs(numbers(info, name, (), MODELS_INFO) - value) > 2e-6 * mesh.radius:
            raise DamagedFile(f"{MODELS_INFO}: {name} is {info[name]}, {MODEL} has {value:.9g}")
