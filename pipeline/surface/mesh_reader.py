"""Reading triangle meshes from PLY, OBJ and STL files: geometry only, no colours, normals or texture coordinates.

All readers end in :func:`oneframe.surface.mesh.checked_mesh`. Writing is :mod:`oneframe.surface.mesh_writer`.

Sources: 3D Systems, "StereoLithography Interface Specification" (1989); for PLY and OBJ see
:mod:`oneframe.surface.ply_reader`.
"""

import codecs
import re
from array import array
from pathlib import Path

import numpy as np

from ..errors import InputError
from ..files.content import read_beginning, read_content
from ..files.numbers import unfinished_warnings
from .mesh import MOST_FACES, TriangleMesh, checked_mesh, distinct_points
from .ply_reader import read_ply
from .winding import consistent_winding

LARGEST_MESH = 768 << 20
"""Bytes of a file: three million triangles as text, many more as numbers."""

MOST_CORNERS = 10_000
"""Corners of the largest polygon."""

SPACES = ("LPS", "RAS")
"""Patient coordinates: x to the left and y to the back (DICOM), or to the right and the front (NIfTI)."""

_SPACE, _SPACE_BYTES = re.compile(rb"\bSPACE=(LPS|RAS)\b"), 4096

_BLOCK = 1 << 18
"""Polygons that are computed at a time, which bounds the memory that it takes."""

_STRAIGHT = 1e-9
"""A corner turns inwards if it does so by more than this part of the polygon's area: less is rounding."""

_AFTER_SLASH = re.compile(rb"(?<=[0-9])/\S*")
"""What follows the vertex of a corner v/vt/vn."""


def read_mesh(path: Path, *, like: Path | None = None) -> tuple[TriangleMesh, list[str]]:
    """Read a surface from a file with extension .ply, .obj or .stl, in upper or lower case.

    Parameters
    ----------
    path
        The file.
    like
        The mesh file in whose patient coordinates, LPS or RAS, this one is wanted, if both state theirs as 3D Slicer
        does (``SPACE=RAS``).

    Returns
    -------
    The mesh in the file's own frame and unit, and messages for the user: what was dropped or turned, signs of damage.
    Polygons are split by :func:`.triangulated`; corners of an STL with equal coordinates become one vertex.
    """
    path = Path(path)
    reader = _READERS.get(path.suffix.lower())
    if reader is None:
        raise InputError(
            f"{path}: expected a mesh file {', '.join(_READERS)}, found extension {path.suffix!r}; "
            "export the surface in one of these formats"
        )
    data = read_content(path, "a mesh file", most=LARGEST_MESH).removeprefix(codecs.BOM_UTF8)
    with np.errstate(invalid="ignore", over="ignore"):  # damaged files hold any number; checked_mesh checks them
        vertices, lengths, corners, messages = reader(data, path.name)
        if (lengths < 3).any():
            short = f"{path.name}: dropped {(lengths < 3).sum()} of {len(lengths)} faces with less than 3 corners"
            messages = [*messages, short]
        triangles = int(np.maximum(lengths - 2, 0).sum())
        if triangles > MOST_FACES or (lengths > MOST_CORNERS).any():
            raise InputError(
                f"{path.name}: expected up to {MOST_FACES:,} triangles, of polygons with up to {MOST_CORNERS:,} "
                f"corners, found {triangles:,} and {lengths.max():,}; decimate the mesh"
            )
        mesh, dropped = checked_mesh(vertices, triangulated(vertices, lengths, corners, path.name), path.name)
    mesh, turned = consistent_winding(mesh, path.name)
    messages = messages + dropped + turned
    space = stated_space(path)
    if like is not None and space and {space, stated_space(like)} == set(SPACES):
        mesh = TriangleMesh(mesh.vertices * (-1.0, -1.0, 1.0), mesh.faces)
        messages.append(f"{path.name}: its coordinates are {space}; turned into those of {like.name}")
    return mesh, messages


def stated_space(path: Path) -> str | None:
    """The patient coordinates that a mesh file states for itself, one of :data:`SPACES`, or ``None``."""
    found = _SPACE.search(read_beginning(path, "a mesh file", _SPACE_BYTES))
    return found[1].decode() if found else None


# --- STL


def _read_stl(data: bytes, where: str) -> tuple[np.ndarray, np.ndarray, np.ndarray, list[str]]:
    """Read binary STL; the result is as that of :func:`oneframe.surface.ply_reader.read_ply`."""
    header, record = 84, 50
    announced = int.from_bytes(data[80:header], "little")
    expected = header + record * announced
    if len(data) < expected and data[:200].lstrip()[:5].lower() == b"solid":
        raise InputError(
            f"{where}: expected a binary STL, found a text or a truncated file; export it as binary STL or PLY, "
            "for example from Blender"
        )
    if len(data) < max(expected, header):
        raise InputError(
            f"{where}: expected {announced:,} triangles in {expected:,} bytes, the file has {len(data):,} bytes; "
            "it is truncated or not an STL file: copy or export it again"
        )
    if announced > MOST_FACES:
        raise InputError(f"{where}: expected up to {MOST_FACES:,} triangles, found {announced:,}; decimate the mesh")
    points = (
        np.ndarray((announced, 3, 3), "<f4", data, header + 12, (record, 12, 4)) if announced else np.empty((0, 3, 3))
    )
    ignored = [f"{where}: ignored {len(data) - expected:,} bytes after the last triangle"] * (len(data) > expected)
    # in the precision of the file, for the memory
    vertices, corners = distinct_points(points.reshape(-1, 3))
    return vertices.astype(np.float64), np.full(len(points), 3), corners, ignored


def triangulated(vertices: np.ndarray, lengths: np.ndarray, corners: np.ndarray, where: str) -> np.ndarray:
    """Split polygons.

    Convex ones become fans around their first corner. A polygon with one corner that turns inwards is seen whole from
    that corner and becomes a fan around it; one with more is refused, but for quadrilaterals, which cross themselves.

    Parameters
    ----------
    vertices
        ``(V, 3)``, finite or not.
    lengths, corners
        ``(P,)`` corners of each polygon; ``(sum,)`` their vertices, which may be out of range: then all are fans.
    where
        Names the file in messages.

    Returns
    -------
    ``(F, 3)`` triangles, polygon by polygon, wound like the polygons; none for those of less than three corners.
    """
    if (lengths == 3).all():
        return corners.reshape(-1, 3)
    if len(corners) and (corners.min() < 0 or corners.max() >= len(vertices)):
        vertices = np.zeros((1, 3))
        shape_of = np.zeros_like(corners)
    else:
        shape_of = corners
    starts = np.cumsum(lengths) - lengths
    is_face = lengths >= 3
    starts, lengths = starts[is_face], lengths[is_face]
    parts = []
    for at in range(0, len(lengths), _BLOCK):
        count, begin = lengths[at : at + _BLOCK], starts[at : at + _BLOCK]
        parts.append(corners[_triangle_places(vertices, shape_of, begin, count, where)])
    return np.concatenate(parts) if parts else np.empty((0, 3), corners.dtype)


def _triangle_places(
    vertices: np.ndarray, corners: np.ndarray, starts: np.ndarray, lengths: np.ndarray, where: str
) -> np.ndarray:
    """``(F, 3)`` places in ``corners`` of the triangles of polygons that begin at ``starts``."""
    polygon = np.repeat(np.arange(len(lengths)), lengths)
    within = np.arange(len(polygon)) - (np.cumsum(lengths) - lengths)[polygon]
    first, length = starts[polygon], lengths[polygon]
    here, after, before = (vertices[corners[first + (within + step) % length]] for step in (0, 1, -1))
    origin = vertices[corners[first]]
    begins = np.cumsum(lengths) - lengths
    normals = np.add.reduceat(np.cross(here - origin, after - origin), begins)
    turns = (np.cross(here - before, after - here) * normals[polygon]).sum(axis=1)
    inward = turns < -_STRAIGHT * (normals**2).sum(axis=1)[polygon]
    inwards = np.add.reduceat(inward.astype(np.int64), begins)
    if ((inwards > 1) & (lengths > 4)).any():
        raise InputError(
            f"{where}: expected polygons with up to one corner that turns inwards, found others; triangulate the mesh, "
            "for example in Blender (Ctrl T)"
        )
    hub = np.zeros(len(lengths), np.int64)
    single = inward & (inwards == 1)[polygon]
    hub[polygon[single]] = within[single]
    per_polygon = lengths - 2
    owner = np.repeat(np.arange(len(lengths)), per_polygon)
    first_triangle = np.cumsum(per_polygon) - per_polygon
    step = np.arange(len(owner)) - first_triangle[owner]
    order = np.stack([np.zeros_like(step), step + 1, step + 2], axis=1) + hub[owner, None]
    places = starts[owner, None] + order % lengths[owner, None]
    return places


def read_obj(data: bytes, where: str) -> tuple[np.ndarray, np.ndarray, np.ndarray, list[str]]:
    """Read the lines ``v`` and ``f``; the result is as that of :func:`oneframe.surface.ply_reader.read_ply`."""
    if b"\0" in data:
        raise InputError(f"{where}: expected a text, found binary data; the file is corrupt: copy or export it again")
    text = data.replace(b"\r\n", b"\n").replace(b"\r", b"\n").replace(b"\\\n", b" ")
    points, lengths, corners, largest, most = array("d"), array("q"), array("q"), 0, 0
    objects, named = set[tuple[bytes, bytes]](), {b"o ": b"", b"g ": b""}
    for number, line in enumerate(text.split(b"\n"), start=1):
        words = line.partition(b"#")[0].lstrip(b" \t")
        kind, words = words[:2].replace(b"\t", b" "), words[2:]
        try:
            if kind == b"v ":
                x, y, z, *_ = map(float, words.split())
                points.extend((x, y, z))
            elif kind == b"f ":
                given = [int(word) for word in _AFTER_SLASH.sub(b"", words).split()]
                # negative numbers count back from the vertices before the line
                known = len(points) // 3
                face = [index - 1 if index > 0 else known + index for index in given]
                if 0 in given or min(face, default=0) < 0:
                    raise ValueError
                if max(face, default=0) > most:
                    largest, most = number, max(face)
                lengths.append(len(face))
                corners.extend(face)
                objects.add((named[b"o "], named[b"g "]))
            elif kind in named:
                named[kind] = words.strip()
        except (ValueError, OverflowError):
            raise InputError(
                f"{where}: line {number}: expected 'v x y z', or 'f' with numbers of vertices, found "
                "something else; the file is truncated or corrupt: copy or export it again"
            ) from None
    if len(corners) and most >= len(points) // 3:
        raise InputError(
            f"{where}: line {largest}: expected vertex numbers 1..{len(points) // 3}, found {most + 1}; "
            "the file is truncated or corrupt: copy or export it again"
        )
    if len(objects) > 1:
        # a nerve would become part of the bone
        raise InputError(
            f"{where}: expected one surface, found {len(objects)} objects or groups (o, g); save each as a file of its "
            "own (3D Slicer: PLY) and give the structures with --structure, or join them, in Blender with Ctrl J"
        )
    vertices = np.array(points, np.float64).reshape(-1, 3)
    return vertices, np.array(lengths, np.int64), np.array(corners, np.int64), unfinished_warnings(data, where)


_READERS = {".ply": read_ply, ".obj": read_obj, ".stl": _read_stl}
