"""Masks: the images of a dataset, decoded without OpenCV, and the run lengths of BOP's image-wise layout."""

import json
import struct
import zlib

import numpy as np

from ..dataset.tables.coco import run_lengths
from ..errors import InputError
from ..images.image_check import PNG_SIGNATURE

_MOST_PIXELS = 1 << 30


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


def mask_json(mask: np.ndarray) -> bytes:
    """The ``(H, W)`` bool mask of the only object as JSON, which BOP's reader decodes without any library."""
    return json.dumps({"0": {"counts": run_lengths(mask), "size": mask.shape}}).encode()


def mask_columns(data: bytes, shape: tuple[int, int], where: str) -> np.ndarray:
    """The mask of :func:`mask_json`, ``(W, H)`` uint8 of 0 and 1: transposed, as run lengths go down the columns.

    Parameters
    ----------
    data, shape
        The JSON, and (H, W) of the mask.
    where
        Names the file in messages.

    Raises
    ------
    InputError
        Something else, or the mask of another size.
    """
    height, width = shape
    pixels = height * width
    try:
        entry = json.loads(data)["0"]
        counts, size = np.array(entry["counts"], np.int64), tuple(entry["size"])
    except (ValueError, KeyError, TypeError, OverflowError, RecursionError):
        counts, size = np.zeros((0, 0), np.int64), ()
    # each of them too: the sum of large ones overflows
    fits = counts.ndim == 1 and bool(((counts >= 0) & (counts <= pixels)).all()) and int(counts.sum()) == pixels
    if size != shape or not fits:
        raise InputError(
            f"{where}: expected the run lengths of a mask of {width}x{height} px, found something else; check the pack "
            "(oneframe pack --verify)"
        )
    return np.repeat(np.arange(len(counts), dtype=np.uint8) & 1, counts).reshape(width, height)
