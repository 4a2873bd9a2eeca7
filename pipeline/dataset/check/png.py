"""PNG files that nobody vouches for: the header before anything else, and no more data than it announces.

Decoders fill what is missing with black and take memory for any size that a header claims. So size and kind must be the
expected ones before a file is read, every chunk must be intact and one that the format of datasets has, and the
compressed data must be exactly the announced rows. Source: W3C, "Portable Network Graphics (PNG) Specification".
"""

import struct
import zlib
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from .files import DamagedFile, opened

LARGEST_IMAGE_PX = 8192**2
"""No view has more pixels."""
_SIGNATURE = b"\x89PNG\r\n\x1a\n"
_CHANNELS = {0: 1, 2: 3}
_HEADER_BYTES = len(_SIGNATURE) + 25


@dataclass(frozen=True)
class PngHeader:
    """Width, height, number of channels and bits of each."""

    width: int
    height: int
    channels: int
    bits: int

    def __str__(self) -> str:
        several = "s" * (self.channels > 1)
        return f"{self.width}x{self.height} px with {self.channels} channel{several} of uint{self.bits}"

    @property
    def row_bytes(self) -> int:
        """Bytes of a filtered row."""
        return 1 + self.width * self.channels * self.bits // 8


def read_png(root: Path, name: str, expected: PngHeader | None = None) -> np.ndarray:
    """Decode a PNG image.

    Parameters
    ----------
    root, name
        The dataset's folder, and the file relative to it.
    expected
        What the image must be; if left out, any grey or RGB image of at most :data:`LARGEST_IMAGE_PX`.

    Returns
    -------
    ``(H, W)`` uint8 or uint16, or ``(H, W, 3)`` uint8, RGB.

    Raises
    ------
    DamagedFile
        Unreadable, no PNG, another size or kind, damaged, or with anything that this format's images do not have.
    """
    with opened(root, name) as (stream, size):
        header = _header(stream.read(_HEADER_BYTES), name)
        if expected is not None and header != expected:
            raise DamagedFile(f"{name}: expected {expected}, found {header}")
        if header.width * header.height > LARGEST_IMAGE_PX:
            raise DamagedFile(f"{name}: expected at most {LARGEST_IMAGE_PX} px, found {header}")
        raw_bytes = header.row_bytes * header.height
        # stored without compression, with room for the chunks
        if size > raw_bytes + raw_bytes // 64 + 4096:
            raise DamagedFile(f"{name}: expected the data of {header}, found {size} bytes")
        stream.seek(0)
        data = stream.read(size)
    _check_data(_compressed(data, name), raw_bytes, name)
    image = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
    if image is None:
        raise DamagedFile(f"{name}: expected a PNG image, found a file that cannot be decoded")
    return image[..., ::-1] if header.channels == 3 else image


def _header(data: bytes, name: str) -> PngHeader:
    if data[:8] != _SIGNATURE:
        raise DamagedFile(f"{name}: expected a PNG image, found a file that starts with {data[:8]!r}")
    if len(data) < _HEADER_BYTES or data[8:16] != b"\0\0\0\rIHDR":
        raise DamagedFile(f"{name}: expected a whole PNG image, the file is cut off or damaged")
    width, height, bits, colour, compression, filtering, interlaced = struct.unpack(">IIBBBBB", data[16:29])
    if colour not in _CHANNELS or bits not in (8, 16) or compression or filtering or interlaced or not width * height:
        raise DamagedFile(
            f"{name}: expected a plain grey or RGB image, found PNG's colour type {colour} of {bits} bits"
        )
    return PngHeader(width, height, _CHANNELS[colour], bits)


def _compressed(data: bytes, name: str) -> bytes:
    """The image data in all chunks, which must be intact."""
    position, kind, parts = len(_SIGNATURE), b"", []
    while kind != b"IEND":
        size, kind = struct.unpack_from(">I4s", data, position) if position + 12 <= len(data) else (0, b"")
        stop = position + 12 + size
        if not kind or stop > len(data):
            raise DamagedFile(f"{name}: expected a whole PNG image, the file is cut off")
        if kind not in (b"IHDR", b"IDAT", b"IEND") or (kind == b"IHDR") != (position == len(_SIGNATURE)):
            raise DamagedFile(f"{name}: expected only pixels in the PNG image, found a chunk {kind!r}")
        if struct.unpack_from(">I", data, stop - 4)[0] != zlib.crc32(data[position + 4 : stop - 4]):
            raise DamagedFile(f"{name}: expected an intact PNG image, chunk {kind!r} is damaged")
        if kind == b"IDAT":
            parts.append(data[position + 8 : stop - 4])
        position = stop
    if position != len(data):
        raise DamagedFile(f"{name}: expected the end of the PNG image, found {len(data) - position} more bytes")
    return b"".join(parts)


def _check_data(compressed: bytes, raw_bytes: int, name: str) -> None:
    """Check that the data decompress to the announced number of bytes, and end there."""
    inflate = zlib.decompressobj()
    try:
        found = len(inflate.decompress(compressed, raw_bytes + 1))
    except zlib.error as error:
        raise DamagedFile(f"{name}: expected an intact PNG image, its pixels are damaged ({error})") from None
    if found != raw_bytes or not inflate.eof or inflate.unused_data:
        raise DamagedFile(f"{name}: expected {raw_bytes} bytes of pixels in the PNG image, found others")
