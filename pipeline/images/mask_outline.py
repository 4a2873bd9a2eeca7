"""Outlines of a mask: closed curves between its pixels and the others, smooth to a fraction of a pixel."""

from dataclasses import dataclass

import numpy as np

from .pixel_values import mask_box

LARGEST_SHIFT_PX = 0.7
"""Farthest that smoothing moves a point from the middle of its pixel's side."""

# walking to the right, down, left and up with the mask on the right-hand side: the corner that a side of the pixel
# starts at, relative to the pixel; the step to its end; and the neighbour beyond the side; all as (x, y)
_START = np.array([(0, 0), (1, 0), (1, 1), (0, 1)])
_STEP = np.array([(1, 0), (0, 1), (-1, 0), (0, -1)])
_BEYOND = np.array([(0, -1), (1, 0), (0, 1), (-1, 0)])


@dataclass(frozen=True)
class Outline:
    """A closed curve with the mask on its right, one point for each side of a pixel that it passes.

    It starts at the highest pixel of the mask on it that has none above, the leftmost of several, so that what is
    counted from there moves with the mask.

    Attributes
    ----------
    points
        ``(N, 2)`` px.
    inner, outer
        ``(N, 2)`` int64 (x, y) of the pixels on either side; ``outer`` may lie just outside the image.
    """

    points: np.ndarray
    inner: np.ndarray
    outer: np.ndarray

    @property
    def lengths(self) -> np.ndarray:
        """``(N,)`` px from each point to the next; the last one closes the curve."""
        return np.hypot(*(np.roll(self.points, -1, axis=0) - self.points).T)


def outlines(mask: np.ndarray, *, sigma_px: float) -> list[Outline]:
    """All outlines of an ``(H, W)`` bool mask, of its parts and of their holes.

    Parameters
    ----------
    mask
        Pixels that touch at a corner only are apart.
    sigma_px
        Standard deviation of the smoothing along the curve. It is corrected once for what it takes away from bends
        (Taubin, "A signal processing approach to fair surface design", SIGGRAPH 1995).
    """
    if not mask.any():
        return []
    rows, columns = mask_box(mask)
    corner = np.array([columns.start, rows.start])
    inner, side = _sides(mask[rows, columns])
    following = _following(inner, side).tolist()
    curves: list[list[int]] = []
    seen = bytearray(len(side))
    # every curve passes tops of pixels, which come first, row by row
    for first in range(int((side == 0).sum())):
        if seen[first]:
            continue
        curve, at = [], first
        while not seen[at]:
            seen[at] = 1
            curve.append(at)
            at = following[at]
        curves.append(curve)
    return [
        Outline(
            _smoothed(inner[curve] + corner + 0.5 * _BEYOND[side[curve]], sigma_px),
            inner[curve] + corner,
            inner[curve] + corner + _BEYOND[side[curve]],
        )
        for curve in curves
    ]


def _sides(mask: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Sides of pixels of the mask to others: ``(S, 2)`` pixel (x, y), ``(S,)`` 0 top, 1 right, 2 bottom, 3 left."""
    padded = np.pad(mask, 1)
    height, width = mask.shape
    found = []
    for x, y in _BEYOND:
        beyond = padded[1 + y : 1 + y + height, 1 + x : 1 + x + width]
        found.append(np.stack(np.nonzero(mask & ~beyond)[::-1], axis=1))
    return np.concatenate(found), np.repeat(np.arange(4), [len(each) for each in found])


def _following(inner: np.ndarray, side: np.ndarray) -> np.ndarray:
    """``(S,)`` the side that follows each on its curve: it turns right where it can, so that corners do not connect."""
    start = inner + _START[side]
    end = start + _STEP[side]
    width, height = start.max(axis=0) + 1
    at = np.full((4, int(width * height)), -1)
    at[side, start[:, 1] * width + start[:, 0]] = np.arange(len(side))
    place = end[:, 1] * width + end[:, 0]
    right, straight, left = (at[(side + turn) % 4, place] for turn in (1, 0, 3))
    return np.where(right >= 0, right, np.where(straight >= 0, straight, left))


def _smoothed(points: np.ndarray, sigma_px: float) -> np.ndarray:
    """Smooth a closed curve of ``(N, 2)`` points about 1 px apart."""
    curve = points[:, 0] + 1j * points[:, 1]
    frequency = 2 * np.pi * np.fft.fftfreq(len(curve))
    lost = 1 - np.exp(-0.5 * (sigma_px * frequency) ** 2)
    shift = np.fft.ifft(np.fft.fft(curve) * -(lost**2))
    length = np.abs(shift)
    shift *= np.minimum(1, LARGEST_SHIFT_PX / np.maximum(length, 1e-12))
    return points + np.stack([shift.real, shift.imag], axis=1)
