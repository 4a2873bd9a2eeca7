"""Texture filtering: averaged frames in which four lookups give the mean over a pixel's footprint.

A pixel of the frame is a mean over its own square already, so the frame is known as a function that is constant on
these squares. A pixel of a view that covers a square of s frame pixels' side shows the mean of this function over it:
a weighted sum of texels, in which the weight of a texel is its overlap with the square. At s = 1 this mean *is* the
bilinear interpolant, so a view at the frame's scale needs no filter, and the frame's own pose gives the frame back.
Below, in enlarged views, no filter could add detail. (The mean of the bilinear interpolant over the footprint would
count the frame's pixels twice, and blur by one pixel too much at every scale.)

Along one axis, the weight is a trapezoid: a box of width s convolved with one of width 1. Bilinear interpolation of
the means over N texels has the weights of s = N. For N < s < N + 1, two such lookups side by side, at a distance that
gives the variance of s, come close: they are exact again for N = 1 and s = 2.

Reference: Heckbert, "Survey of texture mapping", 1986.
"""

from functools import reduce

import numpy as np

LARGEST_SIDE = 32
"""Largest side of the squares, in texels: beyond, the frame covers only a few pixels of the view."""


def squares_for(scale: float) -> tuple[int, float]:
    """The averaged frame for a scale, and where to look it up.

    ``scale`` is the side of the view's pixel in texels.

    Returns
    -------
    side
        Side of the squares of :func:`averaged` to use, texels.
    offset
        Texels: the lookups are at -offset and +offset along either axis. A box of width w has variance w^2 / 12.
    """
    scale = float(np.clip(scale, 1, LARGEST_SIDE))
    side = int(scale)
    return side, float(np.sqrt((scale * scale - side * side) / 12))


def averaged(image: np.ndarray, known: np.ndarray, side: int) -> tuple[np.ndarray, float]:
    """The means over squares of some texels' side, at every texel.

    Parameters
    ----------
    image
        ``(H, W, C)`` float32.
    known
        ``(H, W)`` bool: texels with a valid colour. Others near them are extrapolated, the rest does not matter.
    side
        1 or more texels.

    Returns
    -------
    image
        ``(H, W, C)`` float32.
    place
        The squares' centre relative to the texel's, in texels to the right and down: 0 or 0.5.
    """
    # squares and interpolants reach this far
    result = _continued(image.astype(np.float32), known, steps=side + 1)
    for axis in (0, 1):
        margin = [(0, 0)] * 3
        margin[axis] = ((side - 1) // 2, side // 2)
        result = _box_sums(np.pad(result, margin, mode="edge"), side, axis=axis) / np.float32(side)
    return result, 0.0 if side % 2 else 0.5


def mean_over_pixels(image: np.ndarray, scale: np.ndarray | float) -> np.ndarray:
    """``(H, W, C)`` values at pixel centres -> means over the pixels, where the values vary smoothly.

    Parameters
    ----------
    image
        Values that are means over squares already.
    scale
        Side of a pixel relative to these squares, one or ``(H, W, 1)``. To second order the mean of f over a unit
        square is f + (f_xx + f_yy) / 24, of which means over squares of side 1 / scale have the part 1 / scale^2.

    Notes
    -----
    This fails across edges and for detail near the size of a pixel, which sampling at the centres has already lost or
    aliased.
    """
    part = (np.maximum(1 - 1 / np.square(scale), 0) / 24).astype(np.float32)
    around = np.pad(image, ((1, 1), (1, 1), (0, 0)), mode="edge")
    neighbours = around[2:, 1:-1] + around[:-2, 1:-1] + around[1:-1, 2:] + around[1:-1, :-2]
    return image * (1 - 4 * part) + neighbours * part


def _box_sums(image: np.ndarray, size: int, *, axis: int) -> np.ndarray:
    """Sums of ``size`` neighbours along an axis; the result is ``size`` - 1 shorter."""
    count = image.shape[axis] - size + 1
    parts = (image[(slice(None),) * axis + (slice(first, first + count),)] for first in range(size))
    return reduce(np.add, parts)


def _continued(image: np.ndarray, known: np.ndarray, *, steps: int) -> np.ndarray:
    """Grow the known region by one texel per step; each new texel is the mean of its known neighbours."""
    known, image = known.copy(), np.where(known[..., None], image, 0)
    for _ in range(steps):
        if known.all():
            break
        count = _sums_of_nine(known.astype(np.float32)[..., None])[..., 0]
        total = _sums_of_nine(image)
        new = ~known & (count > 0)
        image[new] = total[new] / count[new][:, None]
        known |= new
    return image


def _sums_of_nine(image: np.ndarray) -> np.ndarray:
    around = np.pad(image, ((1, 1), (1, 1), (0, 0)))
    return _box_sums(_box_sums(around, 3, axis=0), 3, axis=1)
