"""Check before decoding that an image file is complete and that every program shows it the same way up."""

import struct
import zlib
from contextlib import suppress
from pathlib import Path

from ..errors import InputError
from ..files.content import read_content
from .image_header import (
    JPEG_SIGNATURE,
    PNG_SIGNATURE,
    SIGNATURES,
    TIFF_SIGNATURES,
    ImageHeader,
    image_header,
    jpeg_markers,
    tiff_tags,
)

LARGEST_IMAGE = 1 << 26
"""Pixels of the largest image that is decoded."""

LARGEST_FRAME, LARGEST_DEEP_FRAME = 25_000_000, 20_000_000
"""Pixels of the largest frame, and of one with more than 8 bits a channel, for which Blender needs more memory: 1 GB.
4K video has 8.3 million."""

MOST_PIXEL_BYTES = 64
"""Four channels of 32 bits take 16; EXR files may hold some layers more."""

MOST_SCANS = 64
"""Of a progressive JPEG; writers make about ten, and each takes as long as a whole image."""

MOST_CHUNKS = 1_000_000
"""Of a PNG; writers make one of every 8 KB or more."""

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


def check_image_file(path: Path, where: str, *, most_pixels: int = LARGEST_IMAGE) -> bytes:
    """Check that an image file exists, is complete, of a sensible size, and the same image in every program.

    Decoders, Blender's among them, silently fill missing pixels with black. Some, such as OpenCV's, apply the EXIF
    orientation and others, such as Blender's, do not: the same pixel coordinates then mean different pixels. And a file
    of some hundred kilobytes can announce more pixels than fit in memory.

    Parameters
    ----------
    path
        The file.
    where
        Begins the messages.
    most_pixels
        Largest number of pixels that is accepted.

    Returns
    -------
    The bytes that were checked.

    Raises
    ------
    InputError
        Missing, no regular file, empty, not PNG, JPEG, TIFF, BMP or EXR, too large, (PNG, JPEG) damaged or cut off, or
        with an EXIF orientation other than upright.
    """
    data = read_content(path, "an image file", where)
    check_image(data, where, most_pixels=most_pixels)
    return data


def check_image(data: bytes, where: str, *, most_pixels: int = LARGEST_IMAGE) -> ImageHeader:
    """Check the bytes of an image file, as :func:`check_image_file` does.

    Raises
    ------
    InputError
        As :func:`check_image_file`.
    """
    if not data.startswith(SIGNATURES):
        raise InputError(
            f"{where}: expected an image (PNG, JPEG, TIFF, BMP or EXR), found a file that starts with {data[:8]!r}"
        )
    exif = b""
    if data.startswith(PNG_SIGNATURE):
        exif = _checked_png(data, where)
    elif data.startswith(JPEG_SIGNATURE):
        if b"\xff\xd9" not in data[-64 * 1024 :]:
            raise InputError(f"{where}: expected the end of a JPEG image, the file is cut off; copy it again")
        exif = _jpeg_exif(data)
    elif data.startswith(TIFF_SIGNATURES):
        exif = data
    reoriented = _REORIENTED.get(_orientation(exif))
    if reoriented:
        raise InputError(
            f"{where}: expected an upright image, found an EXIF orientation: some programs show it {reoriented}, "
            "others do not; open it, save it as PNG, and give the K of the saved image"
        )
    return _checked_header(data, where, most_pixels)


def _checked_header(data: bytes, where: str, most_pixels: int) -> ImageHeader:
    try:
        header = image_header(data)
    except ValueError as error:
        raise InputError(f"{where}: expected an image, {error}; copy it again, or save it as PNG") from None
    width, height = header.width, header.height
    if not (width > 0 and height > 0):
        raise InputError(f"{where}: expected an image, found one of {width}x{height} px; copy it again")
    if width * height > most_pixels:
        raise InputError(
            f"{where}: expected an image of at most {most_pixels / 1e6:.1f} million pixels, found {width}x{height}; "
            "crop it or scale it down, and give the K of the result"
        )
    if not 0 < header.pixel_bytes <= MOST_PIXEL_BYTES or header.scans > MOST_SCANS:
        raise InputError(
            f"{where}: expected an image of up to four channels, found one of {header.pixel_bytes:g} bytes a pixel in "
            f"{header.scans} scans; save it as PNG"
        )
    return header


def _jpeg_exif(data: bytes) -> bytes:
    """The EXIF block of a JPEG, or nothing."""
    with suppress(ValueError):
        for marker, at in jpeg_markers(data):
            if marker == 0xE1 and data[at : at + 6] == b"Exif\0\0":
                return data[at + 6 : at - 2 + int.from_bytes(data[at - 2 : at], "big")]
            if marker == 0xDA:  # the image data begin
                break
    return b""


def _orientation(exif: bytes) -> int:
    """The orientation in a TIFF or EXIF block; 1, upright, if there is none."""
    try:
        return tiff_tags(exif).get(0x0112, 1)
    except struct.error:
        return 1


def _checked_png(data: bytes, where: str) -> bytes:
    """Check a PNG's chunks; returns its EXIF block, or nothing."""
    position, kind, exif, chunks = len(PNG_SIGNATURE), b"", b"", 0
    view = memoryview(data)  # a slice of bytes would be a copy, of all pixels perhaps
    while kind != b"IEND":
        chunks += 1
        if chunks > MOST_CHUNKS:
            raise InputError(f"{where}: expected a PNG image, found more than {MOST_CHUNKS} chunks; save it again")
        if position + 12 > len(data):
            raise InputError(f"{where}: expected a whole PNG image, the file is cut off; copy it again")
        (size,) = struct.unpack_from(">I", data, position)
        kind, body = data[position + 4 : position + 8], view[position + 8 : position + 8 + size]
        stored = data[position + 8 + size : position + 12 + size]
        if len(stored) < 4:
            raise InputError(f"{where}: expected a whole PNG image, the file is cut off; copy it again")
        if struct.unpack(">I", stored)[0] != zlib.crc32(body, zlib.crc32(kind)):
            raise InputError(f"{where}: expected an intact PNG image, chunk {kind!r} is damaged; copy it again")
        if kind == b"eXIf":
            exif = bytes(body)
        position += 12 + size
    return exif
