"""Size of an image from the header of its file, before anything is decoded.

Sources: PNG (W3C 2003), 11.2.2; JPEG (ITU T.81), B.2.2; TIFF 6.0, section 2; BMP (Microsoft, BITMAPINFOHEADER);
*OpenEXR File Layout*, openexr.com.
"""

import re
import struct
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

PNG_SIGNATURE = b"\x89PNG\r\n\x1a\n"
JPEG_SIGNATURE = b"\xff\xd8\xff"
TIFF_SIGNATURES = (b"II*\0", b"MM\0*")
EXR_SIGNATURE = b"\x76\x2f\x31\x01"
BMP_SIGNATURE = b"BM"

SIGNATURES = (PNG_SIGNATURE, JPEG_SIGNATURE, *TIFF_SIGNATURES, EXR_SIGNATURE, BMP_SIGNATURE)

_JPEG_FRAMES = frozenset(range(0xC0, 0xD0)) - {0xC4, 0xC8, 0xCC}
"""Markers that begin a frame: SOF0 to SOF15, without those of tables."""

_JPEG_MARKER = re.compile(rb"\xff[\x01-\xcf\xd8-\xfe]")
_MOST_JPEG_MARKERS = 10_000

_TIFF_TYPES = {1: 1, 3: 2, 4: 4}
"""Type of a whole number in a TIFF -> its bytes."""

_EXR_CHANNEL_BYTES = {0: 4, 1: 2, 2: 4}


@dataclass(frozen=True)
class ImageHeader:
    """What an image file says about itself.

    Attributes
    ----------
    width, height
        Pixels.
    pixel_bytes
        Bytes that a decoder needs for a pixel.
    scans
        How often a decoder goes over all pixels: more than once for a progressive JPEG.
    """

    width: int
    height: int
    pixel_bytes: float
    scans: int = 1


def image_header(data: bytes) -> ImageHeader:
    """Read the header of a PNG, JPEG, TIFF, EXR or BMP file.

    Raises
    ------
    ValueError
        No such file, or a header without a size.
    """
    try:
        if data.startswith(PNG_SIGNATURE):
            return _png(data)
        if data.startswith(JPEG_SIGNATURE):
            return _jpeg(data)
        if data.startswith(TIFF_SIGNATURES):
            return _tiff(data)
        if data.startswith(EXR_SIGNATURE):
            return _exr(data)
        if data.startswith(BMP_SIGNATURE):
            return _bmp(data)
    except (struct.error, IndexError):
        raise ValueError("its header is cut off or damaged") from None
    except KeyError as error:
        raise ValueError(f"its header is damaged (no {error})") from None
    raise ValueError("it is no image")


def may_have_alpha(data: bytes) -> bool:
    """Whether an image file may have alpha, by its beginning: a JPEG and most PNG without it rule it out."""
    if data.startswith(PNG_SIGNATURE):
        return data[25:26] not in (b"\0", b"\2") or b"tRNS" in data
    return not data.startswith(JPEG_SIGNATURE)


def _png(data: bytes) -> ImageHeader:
    width, height, depth, colours = struct.unpack_from(">IIBB", data, 16)
    if data[12:16] != b"IHDR":
        raise ValueError("it does not begin with its size")
    channels = {0: 1, 2: 3, 3: 1, 4: 2, 6: 4}[colours]
    return ImageHeader(width, height, channels * depth / 8)


def _jpeg(data: bytes) -> ImageHeader:
    found, scans = None, 0
    for marker, at in jpeg_markers(data):
        if marker in _JPEG_FRAMES:
            if found:
                raise ValueError("it holds two frames")
            depth, height, width, channels = struct.unpack_from(">BHHB", data, at)
            found = width, height, channels * depth / 8
        scans += marker == 0xDA
    if found is None or not scans:
        raise ValueError("it has no size or no pixels")
    return ImageHeader(*found, scans)


def jpeg_markers(data: bytes) -> Iterator[tuple[int, int]]:
    """The markers of a JPEG with the offsets of their contents (after the length), up to the end of the image."""
    position = 2
    for _ in range(_MOST_JPEG_MARKERS):
        # not bytes of the pixels (00), padding (FF) and restarts (D0 to D7)
        found = _JPEG_MARKER.search(data, position)
        if found is None or data[found.end() - 1] == 0xD9:
            return
        position = found.end()
        if data[position - 1] not in (0x01, 0xD8):
            yield data[position - 1], position + 2
            position += max(2, int.from_bytes(data[position : position + 2], "big"))
    raise ValueError(f"it has more than {_MOST_JPEG_MARKERS} parts")


def _tiff(data: bytes) -> ImageHeader:
    tags = tiff_tags(data)
    width, height = tags[256], tags[257]
    return ImageHeader(width, height, tags.get(277, 1) * tags.get(258, 1) / 8)


def tiff_tags(data: bytes) -> dict[int, int]:
    """The first value of each tag of whole numbers in a TIFF's first directory, by its number; so too in EXIF.

    Raises
    ------
    ValueError, struct.error
        A directory that is cut off.
    """
    order: Literal["<", ">"] = "<" if data[:2] == b"II" else ">"
    (first,) = struct.unpack_from(order + "I", data, 4)
    (count,) = struct.unpack_from(order + "H", data, first)
    tags: dict[int, int] = {}
    for entry in range(first + 2, first + 2 + 12 * count, 12):
        tag, kind, values, offset = struct.unpack_from(order + "HHII", data, entry)
        size = _TIFF_TYPES.get(kind)
        if size and values:
            at = entry + 8 if size * values <= 4 else offset
            if at + size <= len(data):
                tags.setdefault(tag, int.from_bytes(data[at : at + size], "little" if order == "<" else "big"))
    return tags


def _bmp(data: bytes) -> ImageHeader:
    (header_size,) = struct.unpack_from("<I", data, 14)
    if header_size == 12:
        width, height, _, bits = struct.unpack_from("<HHHH", data, 18)
    else:
        width, height, _, bits = struct.unpack_from("<iiHH", data, 18)
    # a negative height: rows from top to bottom
    return ImageHeader(width, abs(height), bits / 8)


def _exr(data: bytes) -> ImageHeader:
    """The header of the first part; the others of a multi-part file only add to what a decoder needs for a pixel."""
    (version,) = struct.unpack_from("<I", data, 4)
    position, sizes, pixel_bytes = 8, [], 0.0
    while True:
        attributes, position = _exr_attributes(data, position)
        for window in ("dataWindow", "displayWindow"):
            left, top, right, bottom = struct.unpack("<4i", attributes[window])
            sizes.append((right - left + 1, bottom - top + 1))
        pixel_bytes += _exr_channel_bytes(attributes["channels"])
        if not version & 0x1000 or data[position] == 0:
            break
    widths, heights = zip(*sizes, strict=True)
    if min(widths) < 1 or min(heights) < 1:
        raise ValueError("it has no pixels")
    return ImageHeader(max(widths), max(heights), pixel_bytes)


def _exr_attributes(data: bytes, position: int) -> tuple[dict[str, bytes], int]:
    """The attributes of a part, and where the next begins."""
    attributes: dict[str, bytes] = {}
    while data[position]:
        name, position = _exr_name(data, position)
        _, position = _exr_name(data, position)
        (size,) = struct.unpack_from("<I", data, position)
        position += 4 + size
        attributes[name] = data[position - size : position]
    return attributes, position + 1


def _exr_channel_bytes(block: bytes) -> float:
    position, total = 0, 0.0
    while block[position]:
        _, position = _exr_name(block, position)
        kind, _, x_sampling, y_sampling = struct.unpack_from("<iIii", block, position)
        total += _EXR_CHANNEL_BYTES[kind] / max(1, x_sampling) / max(1, y_sampling)
        position += 16
    return total


def _exr_name(data: bytes, position: int) -> tuple[str, int]:
    end = data.find(b"\0", position, position + 257)
    if end < 0:
        raise ValueError("a name in its header has no end")
    return data[position:end].decode("latin-1"), end + 1
