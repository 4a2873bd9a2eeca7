"""Reading triangle meshes from PLY, OBJ and STL files: geometry only, no colours, normals or texture coordinates.

All readers end in :func:`oneframe.surface.mesh.checked_mesh`. Writing is :mod:`oneframe.surface.mesh_writer`.

Sources: 3D Systems, "StereoLithography Interface Specification" (1989); for PLY and OBJ see
:mod:`oneframe.surface.ply_reader` and :mod:`oneframe.surface.obj_reader`.
"""

import re
from pathlib import Path

import numpy as np

from ..errors import InputError
from ..files.content import read_content
from ..files.numbers import first_wrong_word, parsed_numbers
from .mesh import MOST_FACES, TriangleMesh, checked_mesh, distinct_points
from .obj_reader import read_obj
from .ply_reader import read_ply

LARGEST_MESH = 768 << 20
"""Bytes of a file: three million triangles as text, many more as numbers."""

MOST_CORNERS = 10_000
"""Of a polygon."""


def read_mesh(path: Path) -> tuple[TriangleMesh, list[str]]:
    """Read a surface from a file with extension .ply, .obj or .stl, in upper or lower case.

    Returns
    -------
    The mesh in the file's own frame and unit, and messages for the user: what was dropped, and signs of damage.
    Polygons are split as fans around their first corner; corners of an STL with equal coordinates become one vertex.

    Raises
    ------
    InputError
        Another extension; a file that is missing, unreadable, empty, too large, truncated or corrupt; no usable surface
        (see :func:`oneframe.surface.mesh.checked_mesh`).
    """
    path = Path(path)
    reader = _READERS.get(path.suffix.lower())
    if reader is None:
        raise InputError(
            f"{path}: expected a mesh file {', '.join(_READERS)}, found extension {path.suffix!r}; "
            "export the surface in one of these formats"
        )
    data = read_content(path, "a mesh file", most=LARGEST_MESH)
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
        mesh, dropped = checked_mesh(vertices, _fan_triangles(lengths, corners), path.name)
    return mesh, messages + dropped


def _fan_triangles(lengths: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """Polygons with ``lengths`` (P,) corners each, concatenated in ``corners`` (sum,) -> ``(F, 3)`` triangles."""
    if (lengths == 3).all():
        return corners.reshape(-1, 3)
    per_polygon = np.maximum(lengths - 2, 0)
    polygon = np.repeat(np.arange(len(lengths)), per_polygon)
    step = np.arange(len(polygon)) - (np.cumsum(per_polygon) - per_polygon)[polygon]
    first = (np.cumsum(lengths) - lengths)[polygon]
    return corners[np.stack([first, first + step + 1, first + step + 2], axis=1)]


# --- STL


_STL_WORDS = re.compile(
    rb"^[ \t]*(?:end)?solid\b[^\n]*|\b(?:facet[ \t]+normal|outer[ \t]+loop|vertex|endloop|endfacet)\b", re.MULTILINE
)


def _read_stl(data: bytes, where: str) -> tuple[np.ndarray, np.ndarray, np.ndarray, list[str]]:
    """Read text or binary STL; the result is as that of :func:`oneframe.surface.ply_reader.read_ply`."""
    header, record = 84, 50
    announced = int.from_bytes(data[80:header], "little")
    expected = header + record * announced
    messages: list[str] = []
    # a binary header may begin with "solid" too; but a text, read as binary, announces over 100 million triangles
    begins_as_text = data[:200].lstrip()[:5].lower() == b"solid" and b"\0" not in data[:1000]
    if begins_as_text and len(data) < expected:
        points = _stl_text_points(data, where)
    elif len(data) < expected:
        raise InputError(
            f"{where}: expected {announced:,} triangles in {expected:,} bytes, the file has {len(data):,} bytes; "
            "it is truncated or not an STL file: copy or export it again"
        )
    elif announced > MOST_FACES:
        raise InputError(f"{where}: expected up to {MOST_FACES:,} triangles, found {announced:,}; decimate the mesh")
    else:
        shape, strides = (announced, 3, 3), (record, 12, 4)
        points = np.ndarray(shape, "<f4", data, header + 12, strides) if announced else np.empty(shape)
        if len(data) > expected:
            messages.append(f"{where}: ignored {len(data) - expected:,} bytes after the last triangle")
    # in the precision of the file, for the memory
    vertices, corners = distinct_points(points.reshape(-1, 3))
    return vertices.astype(np.float64), np.full(len(points), 3), corners, messages


def _stl_text_points(data: bytes, where: str) -> np.ndarray:
    """``(F, 3, 3)`` corners of the facets of a text STL; several solids in one file become one mesh."""
    text = data.lower().replace(b"\r\n", b"\n").replace(b"\r", b"\n")
    if not re.match(rb"[ \t]*endsolid\b", text.rstrip().rpartition(b"\n")[2]) or b"\0" in data:
        raise InputError(
            f"{where}: expected 'endsolid' in the last line, found the end of the file after {len(data):,} bytes; "
            "it is truncated: copy or export it again"
        )
    rest = _STL_WORDS.sub(b" ", text)
    numbers = parsed_numbers(rest, np.float64)
    if numbers is None:
        line, word = first_wrong_word(rest, np.float64)
        raise InputError(
            f"{where}: line {line + 1}: expected facets of numbers, found {word!r}; "
            "the file is corrupt: copy or export it again"
        )
    facets = text.count(b"endfacet")
    if len(numbers) != 12 * facets:
        raise InputError(
            f"{where}: expected 12 numbers in each of {facets:,} facets, found {len(numbers):,}; "
            "the file is corrupt: copy or export it again"
        )
    # the first three are the normal
    return numbers.reshape(-1, 4, 3)[:, 1:]


_READERS = {".ply": read_ply, ".obj": read_obj, ".stl": _read_stl}
