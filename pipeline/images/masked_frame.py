"""A frame and its mask as one PNG: colours unchanged, alpha 0 where the frame shows no surface, and nothing else."""

import numpy as np

from ..errors import InputError
from .png import encode_png

DEEP = 65535
"""Largest code value of 16 bits."""

UNSEEN = (0.10, 0.25, 1.0)
"""Code values (0..1) that mark unseen surface: a blue that does not occur in bone, blood or mucosa."""
TINT = 0.6
"""Opacity of the colour that marks what is masked."""

_BYTE_STEP = DEEP // 255
"""Between the code values of 8 bits, in those of 16."""


def shown_by_mask(colours: np.ndarray, valid: np.ndarray, where: str) -> np.ndarray:
    """``(H, W)`` bool: where a mask shows the surface.

    Parameters
    ----------
    colours, valid
        ``(H, W, 3)`` code values and ``(H, W)`` bool (alpha above 0) of the mask's file. If any alpha is 0, alpha is
        the mask; otherwise the grey values are: 0 shows no surface, and there is one other value.
    where
        Begins the messages.
    """
    if valid.all():
        valid = (colours > 0).any(axis=2)
        if not (colours[valid] == colours.max()).all():
            raise InputError(
                f"{where}: expected a mask of 0 (shows no surface) and one other value, grey or in alpha, found "
                "colours or shades; set all that is to be hidden to 0 and the rest to 255, without smooth edges"
            )
    return valid


def joined_mask(valid: np.ndarray, shown: np.ndarray, frame: str, mask: str) -> np.ndarray:
    """``(H, W)`` bool of a frame's alpha and its mask together; ``frame`` and ``mask`` are their names in messages."""
    if shown.shape != valid.shape:
        (height, width), (rows, columns) = valid.shape, shown.shape
        raise InputError(
            f"{mask}: expected a mask of {width}x{height} px, the size of {frame}, found {columns}x{rows}; "
            "make it on this frame"
        )
    joined = valid & shown
    if not joined.any():
        raise InputError(f"{mask}: expected a mask that leaves some of {frame}, together they hide all of it")
    return joined


def painted(shown: np.ndarray, way_px: np.ndarray, radius_px: float, *, shows: bool) -> np.ndarray:
    """``(H, W)`` bool: what a frame shows after a round brush went along a way.

    Parameters
    ----------
    shown
        ``(H, W)`` bool.
    way_px
        ``(N, 2)`` pixels (x, y), N at least 1; the brush goes straight from one to the next.
    radius_px
        Of the brush.
    shows
        Whether the brush shows or hides.
    """
    result = shown.copy()
    for start, end in zip(way_px, np.concatenate([way_px[1:], way_px[-1:]]), strict=True):
        first = np.floor(np.minimum(start, end) - radius_px).astype(int).clip(0)
        last = np.ceil(np.maximum(start, end) + radius_px).astype(int).clip(0)
        part = result[first[1] : last[1] + 1, first[0] : last[0] + 1]
        rows, columns = np.indices(part.shape)
        from_start = np.stack([columns, rows], axis=-1) + first - start
        along = end - start
        share = np.clip(from_start @ along / max(along @ along, 1e-12), 0, 1)
        part[np.linalg.norm(from_start - share[..., None] * along, axis=-1) <= radius_px] = shows
    return result


def with_mask_tinted(colours: np.ndarray, valid: np.ndarray) -> np.ndarray:
    """``(H, W, 3)`` float32 code values of a frame, with :data:`TINT` of :data:`UNSEEN` where ``valid`` is False."""
    result = colours.astype(np.float32, copy=True)
    result[~valid] = (1 - TINT) * result[~valid] + TINT * np.array(UNSEEN, np.float32)
    return result


def encoded_frame(colours: np.ndarray, valid: np.ndarray) -> bytes:
    """A frame as PNG, with 8 bits if they hold its values and else with 16; without metadata.

    Parameters
    ----------
    colours, valid
        ``(H, W, 3)`` code values 0..1, and ``(H, W)`` bool, False where alpha becomes 0. There is no alpha if all are
        True.
    """
    codes = np.empty((*colours.shape[:2], 3 if valid.all() else 4), np.uint16)
    # row by row: the products take twice the memory of the frame
    for row, values in enumerate(colours):
        codes[row, :, :3] = np.rint(values.astype(np.float64) * DEEP)
    if codes.shape[2] == 4:
        codes[..., 3] = np.where(valid, DEEP, 0)
    return encode_png(
        codes if any((row % _BYTE_STEP).any() for row in codes) else (codes // _BYTE_STEP).astype(np.uint8)
    )
