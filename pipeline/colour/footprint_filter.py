"""Texture filtering: a prefiltered image in which one lookup gives the mean over a pixel's footprint.

A pixel of a view at scale s of the frame covers a square of side 1/s frame pixels. The mean of the bilinearly
interpolated frame over this square is a weighted sum of texels, with weights that depend on the square's position.
Cubic B-spline interpolation of a suitably convolved frame gives nearly the same weights at every position, so the mean
costs one lookup. (Bilinear lookups of a blurred frame blur again, by an amount that varies with the position.)

References: Unser, "Splines: a perfect fit for signal and image processing", IEEE Signal Processing Magazine 16(6),
1999 (interpolation by B-splines needs such a convolution first); Heckbert, "Survey of texture mapping", 1986.
"""

import numpy as np

TEXEL_CORRELATION = 0.97
"""Assumed correlation of neighbouring texels, for which the kernel is optimal; photographs have 0.9 to 0.99."""

_POSITIONS = (np.arange(8) + 0.5) / 8
_EXTRA_TEXELS = 2


def footprint_kernel(footprint: float) -> np.ndarray:
    """The convolution to apply before cubic B-spline lookups.

    Parameters
    ----------
    footprint
        Side of the averaged square in texels, above 0.

    Returns
    -------
    ``(2 r + 1,)`` symmetric kernel k with sum 1, for both axes. Over all positions x, the sum of k(n) beta3(x - m - n)
    over n is the least-squares approximation of the weight of texel m in the mean of the linear interpolant over
    x - footprint/2 .. x + footprint/2.
    """
    reach = max(2, int(np.ceil(footprint / 2 + 0.5)))
    taps, texels = np.arange(-reach, reach + 1), np.arange(-reach - 3, reach + 4)
    # errors of neighbouring weights cancel to the extent that neighbouring texels correlate
    whitening = np.linalg.cholesky(TEXEL_CORRELATION ** np.abs(texels[:, None] - texels)).T
    halves = np.eye(reach + 1)[np.abs(taps)]
    rows, wanted = [], []
    for position in _POSITIONS:
        upper, lower = (_linear_integral(position + side * footprint / 2 - texels) for side in (1, -1))
        rows.append(whitening @ _cubic_spline(position - texels[:, None] - taps) @ halves)
        wanted.append(whitening @ (upper - lower) / footprint)
    # constrain the sum to 1: the middle tap is 1 minus the others
    system, target = np.concatenate(rows), np.concatenate(wanted)
    others = system[:, 1:] - 2 * system[:, :1]
    half, *_ = np.linalg.lstsq(others, target - system[:, 0], rcond=None)
    return np.concatenate([half[::-1], [1 - 2 * half.sum()], half])


def _cubic_spline(x: np.ndarray) -> np.ndarray:
    x = np.abs(x)
    return np.where(x < 1, 2 / 3 - x**2 + x**3 / 2, np.maximum(2 - x, 0) ** 3 / 6)


def _linear_integral(x: np.ndarray) -> np.ndarray:
    """Integral of the hat function 1 - |t| up to x."""
    x = np.clip(x, -1, 1)
    return 0.5 + x - np.sign(x) * x**2 / 2


def prefiltered(image: np.ndarray, known: np.ndarray, footprint: float) -> np.ndarray:
    """Convolve an image so that cubic B-spline lookups give means over ``footprint`` texels.

    Parameters
    ----------
    image
        ``(H, W, C)`` float32.
    known
        ``(H, W)`` bool: texels with a valid colour. Others near them are extrapolated, the rest does not matter.
    footprint
        Side of the averaged square in texels.

    Returns
    -------
    ``(H, W, C)`` float32.
    """
    kernel = footprint_kernel(footprint).astype(np.float32)
    filled = _continued(image.astype(np.float32), known, steps=len(kernel) // 2 + _EXTRA_TEXELS)
    return _convolved(_convolved(filled, kernel, axis=0), kernel, axis=1)


def mean_over_pixels(image: np.ndarray) -> np.ndarray:
    """``(H, W, C)`` values at pixel centres -> ``(H, W, C)`` means over the pixels, where the values vary smoothly.

    To second order the mean of f over a unit square is f + (f_xx + f_yy) / 24. This fails across edges and for detail
    near the size of a pixel, which sampling at the centres has already lost or aliased.
    """
    around = np.pad(image, ((1, 1), (1, 1), (0, 0)), mode="edge")
    neighbours = around[2:, 1:-1] + around[:-2, 1:-1] + around[1:-1, 2:] + around[1:-1, :-2]
    return image * np.float32(1 - 4 / 24) + neighbours * np.float32(1 / 24)


def _convolved(image: np.ndarray, kernel: np.ndarray, *, axis: int) -> np.ndarray:
    reach, size = len(kernel) // 2, image.shape[axis]
    margin = [(0, 0)] * image.ndim
    margin[axis] = (reach, reach)
    padded = np.pad(image, margin, mode="edge")
    result = np.zeros_like(image)
    for tap, weight in enumerate(kernel):
        result += weight * padded[(slice(None),) * axis + (slice(tap, tap + size),)]
    return result


def _continued(image: np.ndarray, known: np.ndarray, *, steps: int) -> np.ndarray:
    """Grow the known region by one texel per step; each new texel is the mean of its known neighbours."""
    box = np.ones(3, np.float32)
    known, image = known.copy(), np.where(known[..., None], image, 0)
    for _ in range(steps):
        if known.all():
            break
        count = _convolved(_convolved(known.astype(np.float32), box, axis=0), box, axis=1)
        total = _convolved(_convolved(image, box, axis=0), box, axis=1)
        new = ~known & (count > 0)
        image[new] = total[new] / count[new][:, None]
        known |= new
    return image
