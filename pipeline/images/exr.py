"""Read the uncompressed OpenEXR files of one part that Blender's engines write, with float or half channels.

Blender hands the passes of its C++ engines (Eevee) to Python only through a file. A stock Blender has no
EXR reader for Python on every platform, and without compression the format is a header and rows of numbers; anything
beyond that (parts, tiles, deep data, compression) is refused. Format: *OpenEXR File Layout*, openexr.com.
"""

import struct
from pathlib import Path

import numpy as np

_MAGIC = 20000630
_UNSUPPORTED = 0x0200 | 0x0800 | 0x1000
_DTYPES: dict[int, np.dtype] = {0: np.dtype("<u4"), 1: np.dtype("<f2"), 2: np.dtype("<f4")}


class ExrError(ValueError):
    """The file is not an uncompressed scan-line EXR, or it is damaged."""


def read_exr(path: Path) -> dict[str, np.ndarray]:
    """All channels of an EXR file by name, e.g. ``"ViewLayer.Combined.R"``: ``(H, W)`` arrays, top row first.

    Raises
    ------
    ExrError
        Not an EXR file, of several parts, compressed, tiled or deep, or cut off.
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
    attributes, position = _read_header(data, 8)
    if attributes["compression"] != b"\0" or "tiles" in attributes:
        raise ExrError("compressed or tiled")
    left, top, right, bottom = struct.unpack("<4i", attributes["dataWindow"])
    width, height = right - left + 1, bottom - top + 1
    planes: dict[str, np.ndarray] = {}
    block, at = attributes["channels"], 0
    while block[at] != 0:
        name, at = _read_name(block, at)
        kind, _, x_sampling, y_sampling = struct.unpack_from("<iIii", block, at)
        if (x_sampling, y_sampling) != (1, 1):
            raise ExrError("subsampled channels")
        at += 16
        planes[name] = np.empty((height, width), _DTYPES[kind])
    position += 8 * height  # the table of row offsets is not needed: rows are read in turn
    for _ in range(height):
        y, size = struct.unpack_from("<ii", data, position)
        position += 8
        start = position
        for plane in planes.values():
            plane[y - top] = np.frombuffer(data, plane.dtype, width, position)
            position += plane.itemsize * width
        if position - start != size:
            raise ExrError(f"row {y} has {size} bytes, expected {position - start}")
    return planes


def _read_header(data: bytes, position: int) -> tuple[dict[str, bytes], int]:
    attributes: dict[str, bytes] = {}
    while data[position] != 0:
        name, position = _read_name(data, position)
        _, position = _read_name(data, position)
        (size,) = struct.unpack_from("<i", data, position)
        attributes[name] = data[position + 4 : position + 4 + size]
        position += 4 + size
    return attributes, position + 1


def _read_name(data: bytes, position: int) -> tuple[str, int]:
    end = data.index(b"\0", position)
    return data[position:end].decode(), end + 1
