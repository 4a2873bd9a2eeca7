"""Reading triangle meshes from PLY, OBJ and STL files: geometry only, no colours, normals or texture coordinates.

All readers end in :func:`pipeline.surface.mesh.checked_mesh`. Writing is :mod:`pipeline.surface.mesh_writer`.

Sources: Wavefront, "Object Files (.obj)" 3.0; 3D Systems, "StereoLithography Interface Specification" (1989); for PLY
see :mod:`pipeline.surface.ply_reader`.
"""

import re
from pathlib import Path

import numpy as np

from ..errors import InputError
from ..files.content import read_content
from ..files.numbers import first_wrong_word, parsed_numbers, unfinished_warnings
from .mesh import TriangleMesh, checked_mesh
from .ply_reader import read_ply


def read_mesh(path: Path) -> tuple[TriangleMesh, list[str]]:
    """Read a surface from a file with extension .ply, .obj or .stl, in upper or lower case.

    Returns
    -------
    The mesh in the file's own frame and unit, and messages for the user: what was dropped, and signs of damage.
    Polygons are split as fans around their first corner; corners of an STL with equal coordinates become one vertex.

    Raises
    ------
    InputError
        Another extension; a file that is missing, unreadable, empty, truncated or corrupt; no usable surface
        (see :func:`pipeline.surface.mesh.checked_mesh`).
    """
    path = Path(path)
    reader = _READERS.get(path.suffix.lower())
    if reader is None:
        raise InputError(
            f"{path}: expected a mesh file {', '.join(_READERS)}, found extension {path.suffix!r}; "
            "export the surface in one of these formats"
        )
    data = read_content(path, "a mesh file")
    with np.errstate(invalid="ignore", over="ignore"):  # damaged files hold any number; checked_mesh checks them
        vertices, lengths, corners, messages = reader(data, path.name)
        if (lengths < 3).any():
            short = f"{path.name}: dropped {(lengths < 3).sum()} of {len(lengths)} faces with less than 3 corners"
            messages = [*messages, short]
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


# --- Wavefront OBJ


def _read_obj(data: bytes, where: str) -> tuple[np.ndarray, np.ndarray, np.ndarray, list[str]]:
    """Read the lines ``v`` and ``f``; the result is as that of :func:`pipeline.surface.ply_reader.read_ply`."""
    text = data.replace(b"\r\n", b"\n").replace(b"\r", b"\n") if b"\r" in data else data
    text = text.replace(b"\\\n", b" ")  # joined lines count as one in the line numbers of messages
    if b"#" in text:
        text = re.sub(rb"#[^\n]*", b"", text)
    lines = text.split(b"\n")
    if text.startswith((b" ", b"\t")) or b"\n " in text or b"\n\t" in text:
        lines = [line.lstrip() for line in lines]
    vertex_rows = [row for row, line in enumerate(lines) if line[:2] in (b"v ", b"v\t")]
    face_rows = [row for row, line in enumerate(lines) if line[:2] in (b"f ", b"f\t")]

    text = b"\n".join([lines[row][2:] for row in vertex_rows])
    numbers, counts = _obj_numbers(text, np.float64, vertex_rows, where)
    if (counts < 3).any():
        line = vertex_rows[int(np.argmax(counts < 3))] + 1
        raise InputError(
            f"{where}: line {line}: expected 'v x y z', found {counts.min()} numbers; copy or export the file again"
        )
    vertices = numbers[(np.cumsum(counts) - counts)[:, None] + np.arange(3)]  # w or a colour may follow

    text = b"\n".join([lines[row][2:] for row in face_rows])
    if b"/" in text:
        text = re.sub(rb"(?<=[0-9])/\S*", b"", text)  # v/vt/vn -> v
    given, lengths = _obj_numbers(text, np.int64, face_rows, where)
    vertices_before = np.repeat(np.searchsorted(vertex_rows, face_rows), lengths)
    corners = np.where(given > 0, given - 1, given + vertices_before)
    wrong = (given == 0) | (corners < 0) | (corners >= len(vertices))
    if wrong.any():
        first = int(np.argmax(wrong))
        line = face_rows[int(np.searchsorted(np.cumsum(lengths), first, side="right"))] + 1
        raise InputError(
            f"{where}: line {line}: expected vertex numbers 1..{len(vertices)} or negative ones that count back, "
            f"found {given[first]}; the file is truncated or corrupt: copy or export it again"
        )
    return vertices, lengths, corners, unfinished_warnings(data, where)


def _obj_numbers(text: bytes, dtype: type, rows: list[int], where: str) -> tuple[np.ndarray, np.ndarray]:
    """All numbers in the joined lines, and their count per line."""
    numbers = parsed_numbers(text, dtype)
    if numbers is None:
        index, word = first_wrong_word(text, dtype)
        raise InputError(
            f"{where}: line {rows[index] + 1}: expected numbers, found {word!r}; "
            "the file is corrupt: copy or export it again"
        )
    counts = [len(line.split()) for line in text.split(b"\n")] if rows else []
    return numbers, np.array(counts, dtype=np.int64)


# --- STL


_FACET = b"facet normal . . . outer loop vertex x y z vertex x y z vertex x y z endloop endfacet".split()
_NUMBERS = (b".", b"x", b"y", b"z")


def _read_stl(data: bytes, where: str) -> tuple[np.ndarray, np.ndarray, np.ndarray, list[str]]:
    """Read text or binary STL; the result is as that of :func:`pipeline.surface.ply_reader.read_ply`."""
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
    else:
        shape, strides = (announced, 3, 3), (record, 12, 4)
        points = np.ndarray(shape, "<f4", data, header + 12, strides) if announced else np.empty(shape)
        if len(data) > expected:
            messages.append(f"{where}: ignored {len(data) - expected:,} bytes after the last triangle")
    vertices, corners = _merged(points.reshape(-1, 3).astype(np.float64))
    return vertices, np.full(len(points), 3), corners, messages


def _stl_text_points(data: bytes, where: str) -> np.ndarray:
    """``(F, 3, 3)`` corners of the facets of a text STL."""
    text = data.lower().replace(b"\r", b"\n").strip()
    if not re.match(rb"[ \t]*endsolid\b", text[text.rfind(b"\n") + 1 :]):
        raise InputError(
            f"{where}: expected 'endsolid' in the last line, found the end of the file after {len(data):,} bytes; "
            "it is truncated: copy or export it again"
        )
    # several solids in one file become one mesh
    words = re.sub(rb"^[ \t]*(?:end)?solid\b[^\n]*", b"", text, flags=re.MULTILINE).split()
    period = len(_FACET)
    facets, rest = divmod(len(words), period)
    columns = [words[index : facets * period : period] for index in range(period)]
    wrong = [  # (facet, place in it) of the first deviation from each keyword
        (next(facet for facet, word in enumerate(column) if word != meant), place)
        for place, (column, meant) in enumerate(zip(columns, _FACET, strict=True))
        if meant not in _NUMBERS and column.count(meant) < facets
    ]
    if wrong:
        facet, place = min(wrong)
        raise _stl_error(where, facet, f"'{_FACET[place].decode()}'", columns[place][facet])
    if rest:
        raise _stl_error(where, facets, "'endsolid' or a whole facet", words[-rest])
    points = np.empty((facets, 9))
    for axis, place in enumerate(place for place, meant in enumerate(_FACET) if meant in _NUMBERS[1:]):
        numbers = parsed_numbers(b" ".join(columns[place]), np.float64)
        if numbers is None:
            facet, _ = first_wrong_word(b"\n".join(columns[place]), np.float64)
            raise _stl_error(where, facet, "a coordinate", columns[place][facet])
        points[:, axis] = numbers
    return points.reshape(-1, 3, 3)


def _stl_error(where: str, facet: int, expected: str, found: bytes) -> InputError:
    return InputError(
        f"{where}: facet {facet}: expected {expected}, found {found[:30].decode('latin-1')!r}; "
        "the file is corrupt: copy or export it again"
    )


def _merged(points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """``(N, 3)`` points -> ``(M, 3)`` distinct points in lexicographic order, and ``(N,)`` the index of each point."""
    order = np.lexsort(points.T[::-1])
    in_order = points[order]
    first = np.ones(len(points), dtype=bool)
    first[1:] = (in_order[1:] != in_order[:-1]).any(axis=1)
    index = np.empty(len(points), dtype=np.int64)
    index[order] = np.cumsum(first) - 1
    return in_order[first], index


_READERS = {".ply": read_ply, ".obj": _read_obj, ".stl": _read_stl}
