"""The mask images of a dataset, decoded with the standard library: packing needs no OpenCV."""

import struct
import zlib

import numpy as np

from ..errors import InputError
from ..images.image_check import PNG_SIGNATURE


def decoded_mask(data: bytes, where: str) -> np.ndarray:
    """The ``(H, W)`` bool mask of a PNG file as :func:`.encode_png` writes it: 8 bit, grey, rows unfiltered.

    Raises
    ------
    InputError
        It is something else; ``where`` names the file.
    """
    try:
        if data[:8] != PNG_SIGNATURE or data[12:16] != b"IHDR" or data[37:41] != b"IDAT":
            raise ValueError
        width, height, *kind = struct.unpack(">IIBBBBB", data[16:29])
        (length,) = struct.unpack(">I", data[33:37])
        if kind != [8, 0, 0, 0, 0] or not 0 < width * height <= _MOST_PIXELS:
            raise ValueError
        # no more than the header announces, whatever the data hold
        stream = zlib.decompressobj()
        content = stream.decompress(data[41 : 41 + length], height * (1 + width))
        if stream.decompress(stream.unconsumed_tail, 1) or not stream.eof:
            raise ValueError
        rows = np.frombuffer(content, np.uint8).reshape(height, 1 + width)
        if rows[:, 0].any():
            raise ValueError
    except (ValueError, struct.error, zlib.error):
        raise InputError(
            f"{where}: expected a mask as oneframe render writes it, found another image; remove the record of the "
            "view and render it again"
        ) from None
    return rows[:, 1:] > 127


_MOST_PIXELS = 1 << 30
