"""PNG files, written for speed: the Up filter everywhere, and the lowest level of deflate.

In the time of zlib, isal deflates three times, and as small. Its bytes are the same on all processors that Blender runs
on, of one architecture. A stock Blender has zlib alone.
"""

import platform
import struct
import zlib

import numpy as np

from .image_check import PNG_SIGNATURE

try:
    import isal
    from isal.isal_zlib import compressobj
except ImportError:
    compressobj, DEFLATE = zlib.compressobj, f"zlib {zlib.ZLIB_RUNTIME_VERSION}"  # type: ignore[assignment]
else:
    _MACHINE = platform.machine().lower()
    DEFLATE = f"isal {isal.__version__} {dict(amd64='x86_64', aarch64='arm64').get(_MACHINE, _MACHINE)}"
"""What deflates, on which the bytes of a file depend, and not its pixels."""

_COLOUR_TYPES = {1: 0, 3: 2, 4: 6}


def encode_png(image: np.ndarray) -> bytes:
    """An image array as PNG.

    Parameters
    ----------
    image
        ``(H, W)``, ``(H, W, 3)`` or ``(H, W, 4)``, uint8 or uint16, with alpha that multiplies nothing.
    """
    height, width, channels = np.atleast_3d(image).shape
    rows = np.ascontiguousarray(image, dtype=image.dtype.newbyteorder(">")).view(np.uint8).reshape(height, -1)
    filtered = np.empty((height, rows.shape[1] + 1), np.uint8)
    # the Up filter: differences from the row above
    filtered[:, 0] = 2
    filtered[0, 1:] = rows[0]
    np.subtract(rows[1:], rows[:-1], out=filtered[1:, 1:])
    header = struct.pack(">IIBBBBB", width, height, image.dtype.itemsize * 8, _COLOUR_TYPES[channels], 0, 0, 0)
    data = _deflated(filtered.data.cast("B"))
    return PNG_SIGNATURE + _chunk(b"IHDR", header) + _chunk(b"IDAT", data) + _chunk(b"IEND", b"")


def _deflated(content: memoryview) -> bytes:
    # isal's loop hashes what follows the first byte by a register that nobody has set: the address of the stream.
    # Behind a byte that is flushed that does not happen
    stream = compressobj(1)
    parts = stream.compress(content[:1]), stream.flush(zlib.Z_SYNC_FLUSH), stream.compress(content[1:]), stream.flush()
    return b"".join(parts)


def _chunk(kind: bytes, data: bytes) -> bytes:
    return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(data, zlib.crc32(kind)))
