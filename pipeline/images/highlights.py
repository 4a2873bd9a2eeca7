"""Highlights: where a frame shows the reflection of the lamp, and not the colour of the tissue."""

import numpy as np

REACH = 1 / 40
"""Half the side of the square of surroundings, in widths of the frame."""

DARK_QUANTILE, DARK_FACTOR, LEAST_CONTRAST = 0.05, 2.0, 0.1
"""Texture is as strong upwards as downwards, and this quantile of the contrast says how strong. What is this many times
brighter than its surroundings is no texture; nor is it a highlight if it is less brighter than the third, of 1."""

LEAST_WHITENESS = 0.03
"""A reflection is white: the least channel rises by so much more than the greatest one says."""

BLACK = 0.1
"""Code value of what lies around a round view."""

BURNT_OUT_QUANTILE = 0.9995
"""Code value at which the frame's range ends, and with it all colour."""


def highlights(codes: np.ndarray, shown: np.ndarray | None = None) -> np.ndarray:
    """``(H, W)`` bool: the highlights in ``(H, W, 3)`` code values 0..1.

    Parameters
    ----------
    codes
        Of a frame.
    shown
        ``(H, W)`` bool: where it shows the surface; without it, everywhere. What is black is left out.
    """
    least, greatest = codes.min(axis=2).astype(np.float64), codes.max(axis=2).astype(np.float64)
    shown = (greatest > BLACK) if shown is None else shown & (greatest > BLACK)
    if not shown.any():
        return shown
    result = shown & (least >= np.quantile(least[shown], BURNT_OUT_QUANTILE) - 1 / 255) & (least > 0.5)
    # the second time, the surroundings are without the highlights of the first
    for _ in range(2):
        around_least, around_greatest = _surroundings(np.stack([least, greatest], -1), shown & ~result)
        contrast = least - around_least
        texture = -min(float(np.quantile(contrast[shown], DARK_QUANTILE)), 0.0)
        whiteness = least - around_least / np.maximum(around_greatest, 0.02) * greatest
        is_bright = contrast > max(DARK_FACTOR * texture, LEAST_CONTRAST)
        result |= shown & is_bright & (whiteness > LEAST_WHITENESS)
    return result


def _surroundings(values: np.ndarray, counted: np.ndarray) -> np.ndarray:
    """The means of ``(H, W, C)`` values over what is counted near each pixel, ``(C, H, W)``; 0 where nothing is."""
    reach = max(round(REACH * values.shape[1]), 2)
    layers = np.concatenate([values * counted[..., None], counted[..., None]], axis=2)
    sums = np.pad(layers, ((reach + 1, reach), (reach + 1, reach), (0, 0))).cumsum(axis=0).cumsum(axis=1)
    side = 2 * reach + 1
    boxes = sums[side:, side:] - sums[:-side, side:] - sums[side:, :-side] + sums[:-side, :-side]
    return np.moveaxis(boxes[..., :-1] / np.maximum(boxes[..., -1:], 1), -1, 0)
