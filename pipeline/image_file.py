"""PNG files written for speed, and the check that an image file is whole and upright before anything decodes it.

Zlib at its lowest level with run-length matching and the Average filter makes files of the usual size in half the
time of the common defaults; compression beyond that costs more than rendering the frame.
"""

import struct
import zlib
from pathlib import Path
from typing import Literal

import numpy as np

from .errors import InputError

_PNG_SIGNATURE = b"\x89PNG\r\n\x1a\n"
_GREY, _RGB = 0, 2


def eight_bit(values: np.ndarray) -> np.ndarray:
    """Code values 0..1 of any shape -> the nearest uint8 codes; what lies outside is clipped."""
    return np.clip(np.rint(values * 255), 0, 255).astype(np.uint8)


def encode_png(image: np.ndarray) -> bytes:
    """An image array as PNG.

    Parameters
    ----------
    image
        ``(H, W)`` uint8 or uint16, or ``(H, W, 3)`` uint8.
    """
    height, width = image.shape[:2]
    depth = image.dtype.itemsize * 8
    rows = np.ascontiguousarray(image, dtype=image.dtype.newbyteorder(">")).view(np.uint8).reshape(height, -1)
    if image.ndim == 3:
        filtered, strategy = _average_filtered(rows, 3), zlib.Z_RLE
    elif depth == 16:
        filtered, strategy = _sub_filtered(rows, 2), zlib.Z_DEFAULT_STRATEGY
    else:
        # masks: unfiltered rows are runs already
        filtered, strategy = np.concatenate([np.zeros((height, 1), np.uint8), rows], axis=1), zlib.Z_RLE
    deflate = zlib.compressobj(1, zlib.DEFLATED, 15, 9, strategy)
    data = deflate.compress(filtered.data) + deflate.flush()
    colour_type = _RGB if image.ndim == 3 else _GREY
    header = struct.pack(">IIBBBBB", width, height, depth, colour_type, 0, 0, 0)
    return _PNG_SIGNATURE + _chunk(b"IHDR", header) + _chunk(b"IDAT", data) + _chunk(b"IEND", b"")


def _chunk(kind: bytes, data: bytes) -> bytes:
    return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(data, zlib.crc32(kind)))


def _average_filtered(rows: np.ndarray, pixel_bytes: int) -> np.ndarray:
    """PNG filter 3: difference from floor((left + above) / 2), computed without leaving 8 bits."""
    left, above = np.zeros_like(rows), np.zeros_like(rows)
    left[:, pixel_bytes:] = rows[:, :-pixel_bytes]
    above[1:] = rows[:-1]
    filtered = np.empty((rows.shape[0], rows.shape[1] + 1), np.uint8)
    filtered[:, 0] = 3
    np.subtract(rows, (left & above) + ((left ^ above) >> 1), out=filtered[:, 1:])
    return filtered


def _sub_filtered(rows: np.ndarray, pixel_bytes: int) -> np.ndarray:
    """PNG filter 1: difference from the pixel to the left."""
    filtered = np.empty((rows.shape[0], rows.shape[1] + 1), np.uint8)
    filtered[:, 0] = 1
    filtered[:, 1 : 1 + pixel_bytes] = rows[:, :pixel_bytes]
    np.subtract(rows[:, pixel_bytes:], rows[:, :-pixel_bytes], out=filtered[:, 1 + pixel_bytes :])
    return filtered


_TURNED = {
    2: "mirrored left to right",
    3: "turned by 180 degrees",
    4: "mirrored top to bottom",
    5: "mirrored and turned by 90 degrees",
    6: "turned by 90 degrees clockwise",
    7: "mirrored and turned by 90 degrees",
    8: "turned by 90 degrees counter-clockwise",
}
"""EXIF orientation (tag 0x0112, as in TIFF 6.0) -> how an image is to be shown."""


def check_image_file(path: Path, where: str) -> None:
    """Check that an image file is there, not cut off, and the same image to everybody, as far as its format tells.

    Decoders, Blender's among them, fill what is missing with black without a word. And some turn an image as its EXIF
    orientation says, such as OpenCV's, while Blender does not: pixels of the one are not those of the other.

    Raises
    ------
    InputError
        Missing, a folder, empty, not PNG, JPEG, TIFF, BMP or EXR, (PNG, JPEG) damaged or cut off, or to be turned.
    """
    try:
        data = path.read_bytes()
    except FileNotFoundError:
        raise InputError(f"{where}: expected an image file, {path} does not exist; correct the path") from None
    except OSError as error:
        raise InputError(f"{where}: cannot read {path} ({error.strerror})") from None
    exif = b""
    if data.startswith(_PNG_SIGNATURE):
        exif = _checked_png(data, where)
    elif data.startswith(b"\xff\xd8"):
        if b"\xff\xd9" not in data[-64 * 1024 :]:
            raise InputError(f"{where}: expected the end of a JPEG image, the file is cut off; copy it again")
        exif = _jpeg_exif(data)
    elif data.startswith((b"II*\0", b"MM\0*")):
        exif = data
    elif not data.startswith((b"BM", b"\x76\x2f\x31\x01")):
        raise InputError(
            f"{where}: expected an image (PNG, JPEG, TIFF, BMP or EXR), found "
            + ("an empty file" if not data else f"a file that starts with {data[:8]!r}")
        )
    turned = _TURNED.get(_orientation(exif))
    if turned:
        raise InputError(
            f"{where}: expected an image as it is to be shown, found one that is to be {turned} (EXIF orientation), "
            "which some programs do and others do not; open it, save it anew as PNG, and give the K of that image"
        )


def _jpeg_exif(data: bytes) -> bytes:
    """The EXIF block of a JPEG, or nothing."""
    position = 2
    while data[position : position + 1] == b"\xff" and position + 4 <= len(data):
        marker, size = data[position + 1], int.from_bytes(data[position + 2 : position + 4], "big")
        if marker == 0xE1 and data[position + 4 : position + 10] == b"Exif\0\0":
            return data[position + 10 : position + 2 + size]
        if marker == 0xDA:  # the picture begins
            break
        position += 1 if marker == 0xFF else 2 + size
    return b""


def _orientation(exif: bytes) -> int:
    """The orientation in a TIFF or EXIF block; 1, upright, if there is none."""
    order: Literal["little", "big"] = "little" if exif[:2] == b"II" else "big"

    def number(at: int, size: int) -> int:
        return int.from_bytes(exif[at : at + size], order)

    first = number(4, 4)
    for entry in range(first + 2, min(first + 2 + 12 * number(first, 2), len(exif) - 11), 12):
        if number(entry, 2) == 0x0112:
            return number(entry + 8, 2)
    return 1


def _checked_png(data: bytes, where: str) -> bytes:
    """Check a PNG's chunks; gives its EXIF block, or nothing."""
    position, kind, exif = len(_PNG_SIGNATURE), b"", b""
    while kind != b"IEND":
        if position + 12 > len(data):
            raise InputError(f"{where}: expected a whole PNG image, the file is cut off; copy it again")
        (size,) = struct.unpack_from(">I", data, position)
        kind, body = data[position + 4 : position + 8], data[position + 8 : position + 8 + size]
        stored = data[position + 8 + size : position + 12 + size]
        if len(stored) < 4:
            raise InputError(f"{where}: expected a whole PNG image, the file is cut off; copy it again")
        if struct.unpack(">I", stored)[0] != zlib.crc32(body, zlib.crc32(kind)):
            raise InputError(f"{where}: expected an intact PNG image, chunk {kind!r} is damaged; copy it again")
        if kind == b"eXIf":
            exif = body
        position += 12 + size
    return exif
