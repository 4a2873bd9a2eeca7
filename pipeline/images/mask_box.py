"""The part of an image that a mask covers."""

import numpy as np


def mask_box(mask: np.ndarray, margin_px: int = 0) -> tuple[slice, slice]:
    """The rows and columns of an ``(H, W)`` bool mask, with a margin as far as the image goes.

    Raises
    ------
    ValueError
        The mask is empty.
    """
    if not mask.any():
        raise ValueError("expected a mask with pixels in it, found an empty one")
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    height, width = mask.shape
    return (
        slice(max(int(rows[0]) - margin_px, 0), min(int(rows[-1]) + margin_px + 1, height)),
        slice(max(int(columns[0]) - margin_px, 0), min(int(columns[-1]) + margin_px + 1, width)),
    )
