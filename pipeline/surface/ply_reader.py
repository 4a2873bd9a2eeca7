"""Read the vertices and polygons of PLY files, text and binary, whatever other elements and properties they have.

Source: G. Turk, "The PLY Polygon File Format" (Stanford, 1994), with the sized type names of later writers.
"""

import re
import struct
from array import array
from dataclasses import dataclass

import numpy as np

from ..errors import InputError
from ..files.numbers import first_wrong_word, parsed_numbers, unfinished_warnings
from .mesh import MOST_FACES

_TYPES = {
    **dict.fromkeys(("char", "int8"), "i1"),
    **dict.fromkeys(("uchar", "uint8"), "u1"),
    **dict.fromkeys(("short", "int16"), "i2"),
    **dict.fromkeys(("ushort", "uint16"), "u2"),
    **dict.fromkeys(("int", "int32"), "i4"),
    **dict.fromkeys(("uint", "uint32"), "u4"),
    **dict.fromkeys(("float", "float32"), "f4"),
    **dict.fromkeys(("double", "float64"), "f8"),
}
_BYTE_ORDERS = {"ascii": "<", "binary_little_endian": "<", "binary_big_endian": ">"}
LONGEST_HEADER = 256 << 10
"""Bytes."""

MOST_UNEVEN_ROWS = 3_000_000
"""Rows of an element whose lists differ in length; these are followed one by one."""

_HEADER_END = re.compile(rb"[\r\n]end_header[ \t]*(?:\r\n|\n|\r)")


@dataclass(frozen=True)
class _Property:
    """A column of an element; ``length`` is the type of a list's count, ``None`` for a scalar."""

    name: str
    item: np.dtype
    length: np.dtype | None = None


@dataclass(frozen=True)
class _Element:
    name: str
    count: int
    properties: list[_Property]


@dataclass(frozen=True)
class _Column:
    """The ``values`` (sum of lengths,) of a property in the order of rows; ``lengths`` (rows,) only for a list."""

    values: np.ndarray
    lengths: np.ndarray | None = None


def read_ply(data: bytes, where: str) -> tuple[np.ndarray, np.ndarray, np.ndarray, list[str]]:
    """Vertices and polygons of a PLY file.

    Returns
    -------
    ``(V, 3)`` float64 vertices, ``(P,)`` corners per polygon, ``(sum,)`` int64 vertex indices of all polygons,
    concatenated and not checked to be in range, and messages for the user.
    """
    order, elements, start = _header(data, where)
    messages: list[str] = []
    body: bytes | memoryview = data
    size = f"{len(data):,} bytes"
    if order == "ascii":
        messages += unfinished_warnings(data, where)
        text = data[start:]
        numbers = parsed_numbers(text, np.float64)
        if numbers is None:
            line, _ = first_wrong_word(text, np.float64)
            raise InputError(
                f"{where}: line {len(data[:start].splitlines()) + line + 1}: expected only numbers after the header, "
                "found something else; the file is corrupt: copy or export it again"
            )
        # from here on a text body is a binary body in which every type is double
        body = numbers.astype("<f8", copy=False).data.cast("B") if len(numbers) else b""
        start = 0
    columns: dict[str, dict[str, _Column]] = {}
    for element in elements:
        found_columns, start = _columns(body, start, element, where, size)
        columns.setdefault(element.name, found_columns)
    if start < len(body) and order == "ascii":
        raise InputError(
            f"{where}: expected {start // 8} numbers after the header, found {len(body) // 8}; "
            "header and body do not match: export the file again"
        )
    if start < len(body):
        messages.append(f"{where}: ignored {len(body) - start:,} bytes after the last element")
    vertex, face = columns.get("vertex", {}), columns.get("face", {})
    polygons = face.get("vertex_indices") or face.get("vertex_index")
    xyz = [vertex[axis] for axis in "xyz" if axis in vertex and vertex[axis].lengths is None]
    if len(xyz) < 3 or polygons is None or polygons.lengths is None:
        described = "; ".join(f"{e.name} ({', '.join(p.name for p in e.properties)})" for e in elements)
        raise InputError(
            f"{where}: expected elements vertex (x, y, z) and face (list vertex_indices), "
            f"found {described or 'none'}; export the surface as a polygon mesh"
        )
    vertices = np.stack([axis.values for axis in xyz], axis=1).astype(np.float64, copy=False)
    return vertices, polygons.lengths, _whole(polygons.values, where), messages


def _header(data: bytes, where: str) -> tuple[str, list[_Element], int]:
    """Name of the format, elements, and offset of the body."""
    end = _HEADER_END.search(data, 0, LONGEST_HEADER)
    if end is None or not re.match(rb"ply\s", data):
        raise InputError(
            f"{where}: expected a PLY header from 'ply' to 'end_header', found none in "
            f"{min(len(data), LONGEST_HEADER):,} bytes; the file is truncated or in another format: copy or export it "
            "again"
        )
    order, elements = "", []
    lines = [line.decode("latin-1") for line in data[: end.start()].splitlines()]
    for number, line in enumerate(lines[1:], start=2):
        try:
            match line.split():
                case [] | ["comment" | "obj_info", *_]:
                    pass
                case ["format", name, "1.0"] if name in _BYTE_ORDERS:
                    order = name
                case ["element", name, count] if count.isdigit():
                    elements.append(_Element(name, int(count), []))
                case ["property", "list", length, item, name]:
                    elements[-1].properties.append(_Property(name, _dtype(order, item), _dtype(order, length)))
                case ["property", item, name]:
                    elements[-1].properties.append(_Property(name, _dtype(order, item)))
                case _:
                    raise ValueError
        except (ValueError, LookupError):  # not a number, an unknown type, a property before element or format
            raise InputError(
                f"{where}: line {number}: expected a line of a PLY 1.0 header, found another; export it again"
            ) from None
    largest = max(elements, key=lambda element: element.count, default=None)
    # a row has a byte or more; what is cut off is reported as such
    if largest and MOST_FACES < largest.count <= len(data):
        raise InputError(
            f"{where}: expected up to {MOST_FACES:,} rows, found {largest.count:,} of one element; decimate the mesh"
        )
    if not order:
        raise InputError(f"{where}: expected a line 'format ... 1.0' in the PLY header, found none; export it again")
    return order, elements, end.end()


def _dtype(order: str, type_name: str) -> np.dtype:
    """Storage type of a property; raises KeyError for an unknown name or before the format is known."""
    code = _TYPES[type_name]
    return np.dtype(_BYTE_ORDERS[order] + ("f8" if order == "ascii" else code))


def _columns(
    data: bytes | memoryview, start: int, element: _Element, where: str, size: str
) -> tuple[dict[str, _Column], int]:
    """All columns of an element whose rows begin at ``start``, and the offset where its rows end."""
    if element.count == 0 or not element.properties:
        none = np.empty(0, np.int64)
        return {p.name: _Column(none, None if p.length is None else none) for p in element.properties}, start
    found, stop = _walked(data, start, element, 1, where, size)
    # as if all rows had the layout of the first
    fields: list[tuple] = []
    for number, (prop, (_, lengths)) in enumerate(zip(element.properties, found, strict=True)):
        if prop.length is not None:
            fields.append((f"length {number}", prop.length))
        fields.append((f"values {number}", prop.item, (lengths[0],)))
    end = start + (stop - start) * element.count
    if end <= len(data):
        rows = np.frombuffer(data, np.dtype(fields), element.count, start)
        if all((rows[name] == rows[name][0]).all() for name, *_ in fields if name.startswith("length")):
            columns: dict[str, _Column] = {}
            for number, (prop, (_, lengths)) in enumerate(zip(element.properties, found, strict=True)):
                counts = None if prop.length is None else np.full(element.count, lengths[0])
                columns.setdefault(prop.name, _Column(rows[f"values {number}"].ravel(), counts))
            return columns, end
    elif all(prop.length is None for prop in element.properties):
        raise _truncated(element, (len(data) - start) // (stop - start), where, size)
    if element.count > MOST_UNEVEN_ROWS:
        raise InputError(
            f"{where}: expected lists of one length in {element.count:,} rows of element '{element.name[:30]}', found "
            "several; triangulate the mesh"
        )
    found, stop = _walked(data, start, element, element.count, where, size)
    columns = {}
    for prop, (values, lengths) in zip(element.properties, found, strict=True):
        columns.setdefault(prop.name, _Column(np.array(values), None if prop.length is None else np.array(lengths)))
    return columns, stop


def _walked(
    data: bytes | memoryview, position: int, element: _Element, rows: int, where: str, size: str
) -> "tuple[list[tuple[array[float], array[int]]], int]":  # in quotes: Python 3.11 cannot evaluate it
    """Values, and numbers of values, of each property in the first ``rows`` rows; and where these end."""
    found = [(array("d"), array("q")) for _ in element.properties]
    for row in range(rows):
        for prop, (values, lengths) in zip(element.properties, found, strict=True):
            try:
                length = 1
                if prop.length is not None:
                    (length,) = struct.unpack_from(_code(prop.length, 1), data, position)
                    position += prop.length.itemsize
                    if not 0 <= length <= 2**32 or length != int(length):
                        raise InputError(
                            f"{where}: expected the length of a list in row {row} of element '{element.name}', "
                            f"found {length}; the file is corrupt: export it again"
                        )
                values.extend(struct.unpack_from(_code(prop.item, int(length)), data, position))
            except struct.error:
                raise _truncated(element, row, where, size) from None
            lengths.append(int(length))
            position += int(length) * prop.item.itemsize
    return found, position


def _code(dtype: np.dtype, count: int) -> str:
    # struct and numpy agree on the letters of these types
    return f"{dtype.str[0].replace('|', '<')}{count}{dtype.char}"


def _truncated(element: _Element, rows: int, where: str, size: str) -> InputError:
    return InputError(
        f"{where}: expected {element.count} rows of element '{element.name}', the file ({size}) ends after {rows}; "
        "it is truncated: copy or export it again"
    )


def _whole(numbers: np.ndarray, where: str) -> np.ndarray:
    """Vertex indices as int64, whatever type the file stores them in."""
    indices = numbers.astype(np.int64)
    if numbers.dtype.kind == "f" and not np.array_equal(indices, numbers):
        raise InputError(f"{where}: expected whole numbers as vertex indices, found others; the file is corrupt")
    return indices
