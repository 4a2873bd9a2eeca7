"""Similarity of two views over a part of the image. Needs OpenCV."""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from ...images.pixel_values import mask_box

WINDOW_PX = 7
"""Side of SSIM's window (Wang et al. 2004; scikit-image's default)."""


@dataclass(frozen=True)
class Similarity:
    """Similarity of two images over a mask.

    Attributes
    ----------
    ssim
        Mean structural similarity over the mask, windows that leave the mask included.
    psnr
        Peak signal-to-noise ratio, dB; infinite for equal images.
    mean_error
        Mean absolute difference of code values, 0..255.
    pixels
        Pixels of the mask.
    """

    ssim: float
    psnr: float
    mean_error: float
    pixels: int


def similarity(real: np.ndarray, synthetic: np.ndarray, mask: np.ndarray) -> Similarity:
    """Compare ``(H, W, 3)`` images (code values 0..1) over an ``(H, W)`` bool mask.

    Outside the mask both count as equal, so that only the surface is compared.

    Raises
    ------
    ValueError
        Shapes that differ, or an empty mask.
    """
    box = mask_box(mask, WINDOW_PX)
    return whole_and_parts(real[box], synthetic[box], [mask[box]], 0)[1][0]


def whole_and_parts(
    real: np.ndarray, synthetic: np.ndarray, masks: Sequence[np.ndarray], everything: int
) -> tuple[tuple[float, float], list[Similarity]]:
    """Compare over several masks at once, of which the first contains the others.

    Parameters
    ----------
    real, synthetic, masks
        As for :func:`similarity`; black parts of the images may be cut away.
    everything
        Pixels of the whole image; 0: it is not asked for.

    Returns
    -------
    SSIM and PSNR (dB) of the whole image, both black outside the first mask, as in Zhang & Noble (2024): the black
    counts as equal, so the less of the image the surface fills, the higher are both. And for each mask what
    :func:`similarity` gives.
    """
    if real.shape != synthetic.shape or any(mask.shape != real.shape[:2] or not mask.any() for mask in masks):
        raise ValueError(f"expected images and masks of one size, found {real.shape}, {synthetic.shape}, {masks}")
    real, synthetic = (np.ascontiguousarray(image, np.float32) for image in (real, synthetic))
    parts, squares = [], []
    for mask in masks:
        pixels, within = int(np.count_nonzero(mask)), mask.astype(np.uint8)
        squares.append(cv2.norm(real, synthetic, cv2.NORM_L2SQR, within))
        ssim = _ssim_map(real, np.where(mask[..., None], synthetic, real))[mask].mean(dtype=float)
        mean_error = 255 * cv2.norm(real, synthetic, cv2.NORM_L1, within) / (3 * pixels)
        parts.append(Similarity(float(ssim), peak_ratio_db(squares[-1] / (3 * pixels)), mean_error, pixels))
    if not everything:
        return (float("nan"), float("nan")), parts
    black = _ssim_map(*(np.where(masks[0][..., None], image, np.float32(0)) for image in (real, synthetic)))
    lost = black.size - float(black.sum(dtype=float))
    return (1 - lost / everything, peak_ratio_db(squares[0] / (3 * everything))), parts


def peak_ratio_db(mean_square: float) -> float:
    """PSNR in dB from the mean squared difference of code values 0..1."""
    return float("inf") if mean_square == 0 else float(-10 * np.log10(mean_square))


def channel_mean(image: np.ndarray) -> np.ndarray:
    """``(H, W, 3)`` -> ``(H, W)`` float32; numpy is slow along an axis of three."""
    return cv2.transform(np.ascontiguousarray(image, np.float32), np.full((1, 3), 1 / 3))


def _ssim_map(real: np.ndarray, synthetic: np.ndarray) -> np.ndarray:
    """``(H, W)`` local SSIM, mean over the channels: as scikit-image has it."""
    sample = np.float32(WINDOW_PX**2 / (WINDOW_PX**2 - 1))
    real_mean, synthetic_mean = _window_means(real), _window_means(synthetic)
    products, squares = real_mean * synthetic_mean, real_mean**2 + synthetic_mean**2
    covariance = sample * (_window_means(real * synthetic) - products)
    variances = sample * (_window_means(real * real + synthetic * synthetic) - squares)
    c1, c2 = np.float32(0.01**2), np.float32(0.03**2)
    found = (2 * products + c1) * (2 * covariance + c2) / ((squares + c1) * (variances + c2))
    return channel_mean(found)


def _window_means(image: np.ndarray) -> np.ndarray:
    return cv2.blur(image, (WINDOW_PX, WINDOW_PX), borderType=cv2.BORDER_REFLECT)
