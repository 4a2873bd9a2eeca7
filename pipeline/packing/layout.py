"""How a pack lays out a view: names and run lengths of masks as in BOP's image-wise layout, and files beside them.

Source: thodan/bop_toolkit, bop_toolkit_lib/dataset/bop_imagewise.py and bop_webdataset.py.
"""

import json

import numpy as np

from ..dataset.layout import MODEL_FILES, RECORD, TARGETS, ViewPaths
from ..dataset.tables.bop import run_lengths
from ..dataset.truths import MASK, TRUTHS
from ..errors import InputError

KEY_TO_SHARD = "key_to_shard.json"
COPIED = (RECORD, "camera.json", "dataset_info.md", *MODEL_FILES)
"""Files of the dataset that a pack holds as they are."""
TABLES = (*COPIED, TARGETS, KEY_TO_SHARD)
"""The files of a pack beside its shards that the manifest has sums of."""

MASKS = tuple(name for name, truth in TRUTHS.items() if truth.form is MASK)
# the one of several frames first, as packs have always had it
FILES = {
    name: name + truth.form.ending
    for name, truth in sorted(TRUTHS.items(), key=lambda item: not item[1].of_several)
    if name != "rgb" and truth.form is not MASK
}
"""Kinds of a view's files that a pack holds as they are, if the dataset has them, and the members' names."""


def shard_name(number: int) -> str:
    """Name of a shard."""
    return f"shard-{number:06d}.tar"


def view_key(paths: ViewPaths) -> str:
    """The key of a view: the part of its members' names before the first dot."""
    return f"{paths.scene_id:06d}_{paths.image_id:06d}"


def mask_json(mask: np.ndarray) -> bytes:
    """The ``(H, W)`` bool mask of the only object as JSON, which BOP's reader decodes without any library."""
    return json.dumps({"0": {"counts": run_lengths(mask), "size": mask.shape}}).encode()


def mask_columns(data: bytes, shape: tuple[int, int], where: str) -> np.ndarray:
    """The mask of :func:`mask_json`, ``(W, H)`` uint8 of 0 and 1: transposed, as run lengths go down the columns.

    ``shape`` is (H, W) of the mask; ``where`` names the file in messages.
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
