"""Check before decoding that an image file is complete, of a sensible size, and the same image in every program.

Sources: PNG (W3C 2003), 11.2.2; JPEG (ITU T.81), B.2.2; TIFF 6.0, section 2; BMP (Microsoft, BITMAPINFOHEADER);
*OpenEXR File Layout*, openexr.com.
"""

import re
import struct
import zlib
from pathlib import Path

from ..errors import InputError
from ..files.content import read_content

PNG_SIGNATURE = b"\x89PNG\r\n\x1a\n"
JPEG_SIGNATURE = b"\xff\xd8\xff"
_TIFF_SIGNATURES = (b"II*\0", b"MM\0*")
_EXR_SIGNATURE = b"\x76\x2f\x31\x01"
SIGNATURES = (PNG_SIGNATURE, JPEG_SIGNATURE, *_TIFF_SIGNATURES, _EXR_SIGNATURE, b"BM")

LARGEST_IMAGE, LARGEST_FRAME = 1 << 26, 25_000_000
"""Pixels of the largest image that is decoded, and of the largest frame, which Blender opens in 1 GB; 4K has 8.3
million."""

_JPEG_FRAMES = frozenset(range(0xC0, 0xD0)) - {0xC4, 0xC8, 0xCC}
"""Markers that begin a frame: SOF0 to SOF15, without those of tables."""
_TIFF_TYPES = {1: "B", 3: "H", 4: "I"}
"""Type of a whole number in a TIFF -> letter of struct."""
_WIDTH, _HEIGHT, _COLOURS, _ORIENTATION = 256, 257, 262, 274
_PARTS = ((273, 279), (324, 325))
"""Tags of where the strips or tiles of a TIFF begin, and of their bytes."""
_TIFF_TAGS = {_WIDTH, _HEIGHT, _COLOURS, _ORIENTATION, *_PARTS[0], *_PARTS[1]}
_MOST_VALUES = 1 << 20
"""Values of a tag that is looked at; others may hold megabytes."""
_LAB = (8, 9, 10)
_EXR_WINDOW = re.compile(rb"(?:data|display)Window\0box2i\0\x10\0\0\0(.{16})", re.DOTALL)
_EXR_HEADER_BYTES = 64 * 1024

_REORIENTED = {
    2: "mirrored left to right",
    3: "rotated by 180°",
    4: "mirrored top to bottom",
    5: "mirrored and rotated by 90°",
    6: "rotated by 90° clockwise",
    7: "mirrored and rotated by 90°",
    8: "rotated by 90° counter-clockwise",
}
"""EXIF orientation, as in TIFF 6.0 -> how to show the image."""


def check_image_file(path: Path, where: str, *, most_pixels: int = LARGEST_IMAGE) -> bytes:
    """Check that an image file exists, is complete, of a sensible size, and the same image in every program.

    Decoders, Blender's among them, silently fill missing pixels with black. Some, such as OpenCV's, apply the EXIF
    orientation and others, such as Blender's, do not: the same pixel coordinates then mean different pixels. And a file
    of some hundred kilobytes can announce more pixels than fit in memory.

    It gives the bytes that were checked; ``where`` begins the messages.
    """
    data = read_content(path, "an image file", where)
    check_image(data, where, most_pixels=most_pixels)
    return data


def check_image(data: bytes, where: str, *, most_pixels: int = LARGEST_IMAGE) -> tuple[int, int]:
    """Check the bytes of an image file, as :func:`check_image_file` does, and give its width and height."""
    if not data.startswith(SIGNATURES):
        raise InputError(
            f"{where}: expected an image (PNG, JPEG, TIFF, BMP or EXR), found a file that starts with {data[:8]!r}"
        )
    try:
        # what follows the end, such as the film of a phone's moving picture, is not the image's
        if data.startswith(JPEG_SIGNATURE) and data.find(b"\xff\xd9", _jpeg(data)[3]) < 0:
            raise ValueError("the file is cut off")
        if data.startswith(_TIFF_SIGNATURES):
            _check_tiff(data)
        exif = _checked_png(data) if data.startswith(PNG_SIGNATURE) else b""
        width, height, orientation = _size_and_orientation(data)
        reoriented = _REORIENTED.get(_exif_orientation(exif) if exif else orientation)
    except (ValueError, struct.error, IndexError, KeyError) as error:
        reason = error if type(error) is ValueError else "its header is cut off or damaged"
        raise InputError(f"{where}: expected an image, {reason}; copy it again, or save it as PNG") from None
    if reoriented:
        raise InputError(
            f"{where}: expected an upright image, found an EXIF orientation: some programs show it {reoriented}, "
            "others do not; open it, save it as PNG, and give the K of the saved image"
        )
    if not 0 < width * height <= most_pixels:
        raise InputError(
            f"{where}: expected an image of at most {most_pixels / 1e6:.1f} million pixels, found {width}x{height}; "
            "crop it or scale it down, and give the K of the result"
        )
    return width, height


def image_size(data: bytes) -> tuple[int, int]:
    """Width and height in the header of a PNG, JPEG, TIFF, EXR or BMP file.

    Raises
    ------
    ValueError
        No such file, or a damaged header.
    """
    try:
        return _size_and_orientation(data)[:2]
    except (struct.error, IndexError, KeyError):
        raise ValueError("its header is cut off or damaged") from None


def may_have_alpha(data: bytes) -> bool:
    """Whether an image file may have alpha, by its beginning: a JPEG, most PNG and a BMP without it rule it out."""
    if data.startswith(PNG_SIGNATURE):
        return data[25:26] not in (b"\0", b"\2") or b"tRNS" in data
    if data.startswith(b"BM"):
        # a fourth byte is alpha if the header has a mask for it; else it is reserved, often 0
        return len(data) >= 70 and data[30] == 3 and struct.unpack_from("<I", data, 14)[0] >= 56 and any(data[66:70])
    return not data.startswith(JPEG_SIGNATURE)


def _size_and_orientation(data: bytes) -> tuple[int, int, int]:
    """Width, height and EXIF orientation (1 is upright), which of a PNG is left out."""
    if data.startswith(PNG_SIGNATURE):
        return *struct.unpack_from(">II", data, 16), 1
    if data.startswith(JPEG_SIGNATURE):
        return _jpeg(data)[:3]
    if data.startswith(_TIFF_SIGNATURES):
        tags = _tiff_tags(data)
        return tags[_WIDTH][0], tags[_HEIGHT][0], tags.get(_ORIENTATION, (1,))[0]
    if data.startswith(_EXR_SIGNATURE):
        windows = [struct.unpack("<4i", found) for found in _EXR_WINDOW.findall(data, 0, _EXR_HEADER_BYTES)]
        if not windows:
            raise ValueError("its header has no size")
        width = max(right - left + 1 for left, _, right, _ in windows)
        return width, max(bottom - top + 1 for _, top, _, bottom in windows), 1
    if data.startswith(b"BM"):
        is_old = struct.unpack_from("<I", data, 14) == (12,)
        width, height = struct.unpack_from("<HH" if is_old else "<ii", data, 18)
        # a negative height: rows from top to bottom
        return width, abs(height), 1
    raise ValueError("it is no image")


def _checked_png(data: bytes) -> bytes:
    """The EXIF block of a PNG whose chunks are all there and undamaged, or nothing."""
    position, kind, exif = len(PNG_SIGNATURE), b"", b""
    view = memoryview(data)  # a slice of bytes would be a copy, of all pixels perhaps
    while kind != b"IEND":
        size = int.from_bytes(data[position : position + 4], "big")
        kind, body = data[position + 4 : position + 8], view[position + 8 : position + 8 + size]
        if len(data) < position + 12 + size:
            raise ValueError("the file is cut off")
        if struct.unpack_from(">I", data, position + 8 + size) != (zlib.crc32(body, zlib.crc32(kind)),):
            raise ValueError(f"chunk {kind!r} is damaged")
        if kind == b"eXIf":
            exif = bytes(body)
        position += 12 + size
    return exif


def _jpeg(data: bytes) -> tuple[int, int, int, int]:
    """Width, height and EXIF orientation, from the segments before the pixels, and where these begin."""
    position, size, orientation = 2, None, 1
    while data[position + 1] != 0xDA:
        marker, at = data[position + 1], position + 4
        if data[position] != 0xFF:
            raise ValueError("its header is damaged")
        if marker in (0x01, 0xFF):  # without content; padding
            position += 2 if marker == 0x01 else 1
            continue
        if marker in _JPEG_FRAMES:
            _, height, width = struct.unpack_from(">BHH", data, at)
            size = width, height
        if marker == 0xE1 and data[at : at + 6] == b"Exif\0\0":
            orientation = _exif_orientation(data[at + 6 : at - 2 + int.from_bytes(data[at - 2 : at], "big")])
        position += 2 + max(2, int.from_bytes(data[at - 2 : at], "big"))
    if size is None:
        raise ValueError("it has no size")
    return *size, orientation, position


def _exif_orientation(exif: bytes) -> int:
    try:
        return _tiff_tags(exif).get(_ORIENTATION, (1,))[0]
    except struct.error:
        return 1


def _check_tiff(data: bytes) -> None:
    tags = _tiff_tags(data)
    for begins, sizes in _PARTS:
        for begin, size in zip(tags.get(begins, ()), tags.get(sizes, ()), strict=False):
            if begin + size > len(data):
                raise ValueError("the file is cut off")
    if tags.get(_COLOURS, (0,))[0] in _LAB:
        raise ValueError("its colours are L*a*b*, which programs convert in different ways")


def _tiff_tags(data: bytes) -> dict[int, tuple[int, ...]]:
    """The values of the tags of :data:`_TIFF_TAGS` in a TIFF's first directory, by number; so too in EXIF."""
    order = "<" if data[:2] == b"II" else ">"
    (first,) = struct.unpack_from(order + "I", data, 4)
    (count,) = struct.unpack_from(order + "H", data, first)
    tags: dict[int, tuple[int, ...]] = {}
    for entry in range(first + 2, first + 2 + 12 * count, 12):
        tag, kind, values, offset = struct.unpack_from(order + "HHII", data, entry)
        if tag in _TIFF_TAGS and kind in _TIFF_TYPES and 0 < values <= _MOST_VALUES:
            form = f"{order}{values}{_TIFF_TYPES[kind]}"
            at = entry + 8 if struct.calcsize(form) <= 4 else offset
            if at + struct.calcsize(form) <= len(data):
                tags.setdefault(tag, struct.unpack_from(form, data, at))
    return tags
