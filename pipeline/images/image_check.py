"""Check before decoding that an image file is complete and that every program shows it the same way up."""

import struct
import zlib
from pathlib import Path
from typing import Literal

from ..errors import InputError
from ..files.content import read_content
from .png import PNG_SIGNATURE

_REORIENTED = {
    2: "mirrored left to right",
    3: "rotated by 180°",
    4: "mirrored top to bottom",
    5: "mirrored and rotated by 90°",
    6: "rotated by 90° clockwise",
    7: "mirrored and rotated by 90°",
    8: "rotated by 90° counter-clockwise",
}
"""EXIF orientation (tag 0x0112, as in TIFF 6.0) -> how to show the image."""


def check_image_file(path: Path, where: str) -> None:
    """Check that an image file exists, is complete and shows the same image in every program.

    Decoders, Blender's among them, silently fill missing pixels with black. Some, such as OpenCV's, apply the EXIF
    orientation and others, such as Blender's, do not: the same pixel coordinates then mean different pixels.

    Raises
    ------
    InputError
        Missing, a folder, empty, not PNG, JPEG, TIFF, BMP or EXR, (PNG, JPEG) damaged or cut off, or with an EXIF
        orientation other than upright.
    """
    data = read_content(path, "an image file", where)
    exif = b""
    if data.startswith(PNG_SIGNATURE):
        exif = _checked_png(data, where)
    elif data.startswith(b"\xff\xd8"):
        if b"\xff\xd9" not in data[-64 * 1024 :]:
            raise InputError(f"{where}: expected the end of a JPEG image, the file is cut off; copy it again")
        exif = _jpeg_exif(data)
    elif data.startswith((b"II*\0", b"MM\0*")):
        exif = data
    elif not data.startswith((b"BM", b"\x76\x2f\x31\x01")):
        raise InputError(
            f"{where}: expected an image (PNG, JPEG, TIFF, BMP or EXR), found a file that starts with {data[:8]!r}"
        )
    reoriented = _REORIENTED.get(_orientation(exif))
    if reoriented:
        raise InputError(
            f"{where}: expected an upright image, found an EXIF orientation: some programs show it {reoriented}, "
            "others do not; open it, save it as PNG, and give the K of the saved image"
        )


def _jpeg_exif(data: bytes) -> bytes:
    """The EXIF block of a JPEG, or nothing."""
    position = 2
    while data[position : position + 1] == b"\xff" and position + 4 <= len(data):
        marker, size = data[position + 1], int.from_bytes(data[position + 2 : position + 4], "big")
        if marker == 0xE1 and data[position + 4 : position + 10] == b"Exif\0\0":
            return data[position + 10 : position + 2 + size]
        if marker == 0xDA:  # the image data begin
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
    """Check a PNG's chunks; returns its EXIF block, or nothing."""
    position, kind, exif = len(PNG_SIGNATURE), b"", b""
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
