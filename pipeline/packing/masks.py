"""Masks as the run lengths of BOP's image-wise layout."""

import json

import numpy as np

from ..dataset.tables.coco import run_lengths
from ..errors import InputError


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
