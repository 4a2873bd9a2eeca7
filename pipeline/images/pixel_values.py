"""Pixel values: interpolated between centres, as 8-bit codes, as linear light; and boxes of masks."""

import numpy as np

from .transfer import SRGB, Transfer

ROUNDING_PX = 1e-3
"""Largest rounding error of a pixel centre that is unprojected and projected again."""


def sample_bilinear(image: np.ndarray, pixels: np.ndarray) -> np.ndarray:
    """Sample ``(H, W)`` or ``(H, W, C)`` at ``(N, 2)`` pixels; 0 outside, also in the outer half pixel.

    A pixel is inside if :func:`among_centres` says so: all its neighbours of non-zero weight exist.
    """
    height, width = image.shape[:2]
    inside = among_centres(pixels, (width, height))
    u = np.clip(np.where(inside, pixels[:, 0], 0), 0, width - 1)
    v = np.clip(np.where(inside, pixels[:, 1], 0), 0, height - 1)
    left, top = np.minimum(u.astype(np.int64), max(width - 2, 0)), np.minimum(v.astype(np.int64), max(height - 2, 0))
    right, bottom = np.minimum(left + 1, width - 1), np.minimum(top + 1, height - 1)
    across, down = u - left, v - top
    if image.ndim == 3:
        across, down, inside = across[:, None], down[:, None], inside[:, None]
    upper = image[top, left] * (1 - across) + image[top, right] * across
    lower = image[bottom, left] * (1 - across) + image[bottom, right] * across
    return np.where(inside, upper * (1 - down) + lower * down, 0)


def among_centres(pixels: np.ndarray, size_wh: tuple[int, int]) -> np.ndarray:
    """``(N, 2)`` pixels -> ``(N,)`` bool: inside the grid of an image's pixel centres; NaN is outside."""
    # coordinates computed from a pixel's own ray may miss its centre by rounding; that is not "outside"
    # column by column: numpy is slow at reductions along an axis of two
    inside = np.ones(len(pixels), dtype=bool)
    for column, size in zip(pixels.T, size_wh, strict=True):
        inside &= (column >= -ROUNDING_PX) & (column <= size - 1 + ROUNDING_PX)
    return inside


def to_uint8(values: np.ndarray) -> np.ndarray:
    """Code values 0..1 of any shape -> the nearest uint8 codes; values outside 0..1 are clipped."""
    return np.clip(np.rint(values * 255), 0, 255).astype(np.uint8)


def linear_from_codes(codes: np.ndarray, curve: Transfer = SRGB) -> np.ndarray:
    """Code values -> linear light, float64 of any shape."""
    codes = np.asarray(codes, dtype=np.float64)
    power = ((np.maximum(codes, 0) + curve.shift) / (1 + curve.shift)) ** curve.gamma
    return np.where(codes <= curve.straight, codes / curve.slope, power)


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


def grown(flags: np.ndarray, margin_px: int) -> np.ndarray:
    """Flags ``(H, W)`` bool, and what is up to so many pixels beside them, along rows and columns."""
    for axis in (0, 1):
        padded = np.pad(flags, [(margin_px, margin_px) if each == axis else (0, 0) for each in (0, 1)])
        size = flags.shape[axis]
        flags = np.any([padded.take(range(at, at + size), axis) for at in range(2 * margin_px + 1)], axis=0)
    return flags
