"""The model of a dataset: its file, its geometry's hash, its normals and ``models_info.json``.

The file is read here with the layout that the format promises, and the normals are computed here from the geometry.
"""

import functools
import hashlib
import re
from collections.abc import Callable
from pathlib import Path

import numpy as np

from ...surface.mesh import LARGEST_COORDINATE, TriangleMesh, diameter
from ..layout import OBJECT_ID
from .files import DamagedFile, mapping, numbers, opened, read_object, require_keys, shortened
from .findings import Findings

MODEL, MODELS_INFO = f"models/obj_{OBJECT_ID:06d}.ply", "models/models_info.json"
REDUCED, REDUCED_INFO = f"models_eval/obj_{OBJECT_ID:06d}.ply", "models_eval/models_info.json"
REDUCED_VERTICES = 10_000
"""Most vertices of the model for errors of poses."""
LARGEST_MODEL = 1 << 31
"""Bytes; ten million vertices have less than half of it."""
ROUNDING = 2.0**-24
"""Largest relative error of a number stored in single precision."""

_HEADER = re.compile(
    rb"ply\nformat binary_little_endian 1\.0\n(?:comment [^\n]*\n)*"
    rb"element vertex ([0-9]{1,10})\n"
    rb"property float x\nproperty float y\nproperty float z\n"
    rb"property float nx\nproperty float ny\nproperty float nz\n"
    rb"(property uchar red\nproperty uchar green\nproperty uchar blue\n)?"
    rb"element face ([0-9]{1,10})\nproperty list uchar int vertex_indices\nend_header\n"
)
_VERTEX = np.dtype([("xyz", "<f4", 3), ("normal", "<f4", 3)])
_COLOURED = np.dtype([("xyz", "<f4", 3), ("normal", "<f4", 3), ("rgb", "u1", 3)])
_FACE = np.dtype([("count", "u1"), ("corners", "<i4", 3)])


def check_model(
    root: Path, missing: frozenset[str], geometry_sha256: object, findings: Findings
) -> TriangleMesh | None:
    """Check the model's files; return the mesh, or ``None`` if it is missing or unreadable."""
    if MODEL in missing:
        return None
    try:
        mesh, normals = _read_model(root, MODEL, coloured=True)
    except DamagedFile as damage:
        findings.add("damaged files", damage)
        return None
    _collect(findings, lambda: _check_geometry(mesh, geometry_sha256))
    _collect(findings, lambda: _check_centre(mesh))
    _collect(findings, lambda: _check_normals(mesh, normals, MODEL))
    if REDUCED not in missing:
        _collect(findings, lambda: _check_reduced(root, mesh))
    info = _info(mesh)
    for name in {MODELS_INFO, REDUCED_INFO} - missing:
        _collect(findings, functools.partial(_check_info, root, name, info, mesh.radius), "tables that disagree")
    return mesh


def _collect(findings: Findings, check: Callable[[], None], kind: str = "damaged files") -> None:
    try:
        check()
    except DamagedFile as damage:
        findings.add(kind, damage)


def _read_model(root: Path, name: str, *, coloured: bool) -> tuple[TriangleMesh, np.ndarray]:
    """The mesh, and ``(V, 3)`` normals."""
    with opened(root, name) as (stream, size):
        header = _HEADER.match(stream.read(4096))
        if header is None or (header[2] is not None) != coloured:
            colours = "normals and colours" if coloured else "and normals"
            raise DamagedFile(f"{name}: expected a binary PLY with positions, {colours}, found another header")
        vertex = _COLOURED if coloured else _VERTEX
        vertex_count, face_count = int(header[1]), int(header[3])
        expected = header.end() + vertex_count * vertex.itemsize + face_count * _FACE.itemsize
        if size != expected or size > LARGEST_MODEL or not vertex_count or not face_count:
            raise DamagedFile(
                f"{name}: expected {expected} bytes for {vertex_count} vertices and {face_count} faces, found {size}"
            )
        stream.seek(header.end())
        data = stream.read(expected - header.end())
    if len(data) != expected - header.end():
        raise DamagedFile(f"{name}: the file is changing")
    vertices = np.frombuffer(data, vertex, vertex_count)
    faces = np.frombuffer(data, _FACE, face_count, vertices.nbytes)
    if not (np.abs(vertices["xyz"]) < LARGEST_COORDINATE).all():
        raise DamagedFile(f"{name}: expected coordinates in mm, found NaN, infinity or larger than 1000 km")
    corners = faces["corners"]
    if (faces["count"] != 3).any() or corners.min() < 0 or corners.max() >= vertex_count:
        raise DamagedFile(f"{name}: expected triangles of vertices 0 to {vertex_count - 1}, found others")
    mesh = TriangleMesh(vertices["xyz"].astype(np.float64), np.ascontiguousarray(corners, np.int32))
    return mesh, vertices["normal"]


def _check_geometry(mesh: TriangleMesh, expected: object) -> None:
    vertices = mesh.vertices.astype("<f4").tobytes()
    # the hash is that of the surface as given; a surface whose back the frame sees is written with its faces turned
    for faces in (mesh.faces, mesh.faces[:, ::-1]):
        if hashlib.sha256(vertices + faces.astype("<i4").tobytes()).hexdigest() == expected:
            return
    raise DamagedFile(f"{MODEL}: its vertices and faces do not have the geometry_sha256 of dataset.json")


def _check_centre(mesh: TriangleMesh) -> None:
    off = float(np.abs(mesh.vertices.mean(axis=0)).max())
    if off > 2e-6 * mesh.radius:
        raise DamagedFile(f"{MODEL}: expected the mean of the vertices at the origin, it is {off:.2g} mm off")


def _check_normals(mesh: TriangleMesh, found: np.ndarray, name: str) -> None:
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
            f"{name}: {int(wrong.sum())} of {len(wrong)} normals are not those of the surface "
            f"(first: vertex {int(np.flatnonzero(known)[np.argmax(wrong)])})"
        )


def _check_reduced(root: Path, mesh: TriangleMesh) -> None:
    """Check the model for errors of poses: the model itself if it is small, else fewer vertices inside its box."""
    reduced, normals = _read_model(root, REDUCED, coloured=False)
    if len(mesh.vertices) <= REDUCED_VERTICES:
        if not (np.array_equal(reduced.vertices, mesh.vertices) and np.array_equal(reduced.faces, mesh.faces)):
            raise DamagedFile(f"{REDUCED}: expected the surface of {MODEL}, found another")
    else:
        low, high = mesh.bounds + np.array([[-1.0], [1.0]]) * 2 * ROUNDING * mesh.radius
        if not ((reduced.vertices >= low) & (reduced.vertices <= high)).all():
            raise DamagedFile(f"{REDUCED}: expected vertices within the box of {MODEL}, found others")
    _check_normals(reduced, normals, REDUCED)


def _info(mesh: TriangleMesh) -> dict[str, np.ndarray]:
    low, high = mesh.bounds
    expected = {"diameter": np.array(diameter(mesh.vertices)), "box_centre_mm": (low + high) / 2}
    expected |= {f"min_{axis}": value for axis, value in zip("xyz", low, strict=True)}
    return expected | {f"size_{axis}": value for axis, value in zip("xyz", high - low, strict=True)}


def _check_info(root: Path, where: str, expected: dict[str, np.ndarray], radius: float) -> None:
    content = read_object(root, where)
    require_keys(content, {str(OBJECT_ID)}, where)
    info = mapping(content, str(OBJECT_ID), where)
    require_keys(info, set(expected), where)
    for name, value in expected.items():
        if np.abs(numbers(info, name, np.shape(value), where) - value).max() > 2e-6 * radius:
            raise DamagedFile(f"{where}: {name} is {shortened(info[name])}, {MODEL} has {shortened(value.tolist())}")
