"""Read the uncompressed OpenEXR files that Blender's engines write: single- and multi-part, float or half channels.

Blender hands the passes of its C++ engines (Eevee) to Python only through a file. A stock Blender has no
EXR reader for Python on every platform, and without compression the format is a header and rows of numbers; anything
beyond that (tiles, deep data, compression) is refused. Format: *OpenEXR File Layout*, openexr.com.
"""

import struct
from dataclasses import dataclass
from pathlib import Path

import numpy as np

_MAGIC = 20000630
_MULTIPART, _UNSUPPORTED = 0x1000, 0x0200 | 0x0800
_DTYPES: dict[int, np.dtype] = {0: np.dtype("<u4"), 1: np.dtype("<f2"), 2: np.dtype("<f4")}


class ExrError(ValueError):
    """The file is not an uncompressed scan-line EXR, or it is damaged."""


@dataclass(frozen=True)
class _Part:
    channels: tuple[tuple[str, np.dtype], ...]
    width: int
    height: int
    first_row: int


def read_exr(path: Path) -> dict[str, np.ndarray]:
    """All channels of an EXR file by name, e.g. ``"ViewLayer.Combined.R"``: ``(H, W)`` arrays, top row first.

    Raises
    ------
    ExrError
        Not an EXR file, compressed, tiled or deep, or cut off.
    """
    data = path.read_bytes()
    try:
        return _parse(data)
    except (struct.error, IndexError, ValueError) as error:
        raise ExrError(f"{path}: not an uncompressed scan-line EXR file, or damaged ({error})") from error


def _parse(data: bytes) -> dict[str, np.ndarray]:
    magic, version = struct.unpack_from("<ii", data)
    if magic != _MAGIC or version & _UNSUPPORTED:
        raise ExrError("unexpected magic number or flags")
    multipart = bool(version & _MULTIPART)
    parts, position = [], 8
    while True:
        part, position = _read_header(data, position)
        parts.append(part)
        if not multipart:
            break
        if data[position] == 0:
            position += 1
            break
    position += 8 * sum(part.height for part in parts)  # the table of row offsets is not needed: rows are read in turn
    channels: dict[str, np.ndarray] = {}
    rows: list[list[np.ndarray]] = []
    for part in parts:
        planes = [np.empty((part.height, part.width), dtype) for _, dtype in part.channels]
        rows.append(planes)
        channels.update({name: plane for (name, _), plane in zip(part.channels, planes, strict=True)})
    for _ in range(sum(part.height for part in parts)):
        index = 0
        if multipart:
            (index,) = struct.unpack_from("<i", data, position)
            position += 4
        y, size = struct.unpack_from("<ii", data, position)
        position += 8
        part, start = parts[index], position
        for (_, dtype), plane in zip(part.channels, rows[index], strict=True):
            plane[y - part.first_row] = np.frombuffer(data, dtype, part.width, position)
            position += dtype.itemsize * part.width
        if position - start != size:
            raise ExrError(f"row {y} has {size} bytes, expected {position - start}")
    return channels


def _read_header(data: bytes, position: int) -> tuple[_Part, int]:
    attributes: dict[str, bytes] = {}
    while data[position] != 0:
        name, position = _read_name(data, position)
        _, position = _read_name(data, position)
        (size,) = struct.unpack_from("<i", data, position)
        attributes[name] = data[position + 4 : position + 4 + size]
        position += 4 + size
    if attributes["compression"] != b"\0" or "tiles" in attributes:
        raise ExrError("compressed or tiled")
    left, top, right, bottom = struct.unpack("<4i", attributes["dataWindow"])
    # in a multi-part file the part's name is the prefix that a single-part file spells out in the channel's name
    prefix = attributes["name"].decode() + "." if "name" in attributes else ""
    channels: list[tuple[str, np.dtype]] = []
    block, at = attributes["channels"], 0
    while block[at] != 0:
        name, at = _read_name(block, at)
        kind, _, x_sampling, y_sampling = struct.unpack_from("<iIii", block, at)
        if (x_sampling, y_sampling) != (1, 1):
            raise ExrError("subsampled channels")
        at += 16
        full_name = name if not prefix or name.startswith(prefix) else prefix + name
        channels.append((full_name, _DTYPES[kind]))
    return _Part(tuple(channels), right - left + 1, bottom - top + 1, top), position + 1


def _read_name(data: bytes, position: int) -> tuple[str, int]:
    end = data.index(b"\0", position)
    return data[position:end].decode(), end + 1
