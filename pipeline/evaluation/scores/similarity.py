"""Similarity of two views over a part of the image. Needs OpenCV."""

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
    correlation
        Pearson correlation of grey values: unlike the others, invariant to brightness and contrast; NaN where an image
        is uniform.
    pixels
        Pixels of the mask.
    """

    ssim: float
    psnr: float
    mean_error: float
    correlation: float
    pixels: int


def similarity(real: np.ndarray, synthetic: np.ndarray, mask: np.ndarray) -> Similarity:
    """Compare ``(H, W, 3)`` images (code values 0..1) over an ``(H, W)`` bool mask.

    Outside the mask both count as equal, so that only the surface is compared.

    Raises
    ------
    ValueError
        Shapes that differ, or an empty mask.
    """
    _check(real, synthetic, mask)
    box = mask_box(mask, WINDOW_PX)
    real, synthetic, mask = real[box], synthetic[box], mask[box]
    shown = np.where(mask[..., None], synthetic, real)
    difference = real[mask].astype(float) - synthetic[mask]
    return Similarity(
        ssim=float(_ssim_map(real, shown)[mask].mean()),
        psnr=peak_ratio_db(float(np.mean(difference**2))),
        mean_error=float(np.abs(difference).mean() * 255),
        correlation=_correlation(real[mask].mean(axis=1), synthetic[mask].mean(axis=1)),
        pixels=int(np.count_nonzero(mask)),
    )


def segmented_similarity(real: np.ndarray, synthetic: np.ndarray, mask: np.ndarray) -> tuple[float, float]:
    """SSIM and PSNR (dB) of the whole image, both black outside the mask, as in Zhang & Noble (2024).

    The black background counts as equal, so the less of the image the surface fills, the higher are both.

    Raises
    ------
    ValueError
        As :func:`similarity`.
    """
    _check(real, synthetic, mask)
    # outside, SSIM is 1
    box, everything = mask_box(mask, WINDOW_PX), mask.size
    inside = mask[box][..., None]
    real, synthetic = np.where(inside, real[box], 0), np.where(inside, synthetic[box], 0)
    found = _ssim_map(real, synthetic)
    # farther from the mask than a window both are black, hence equal
    ssim = 1 - float((1 - found.astype(float)).sum()) / everything
    squares = float(((real.astype(float) - synthetic) ** 2).sum())
    return ssim, peak_ratio_db(squares / (3 * everything))


def peak_ratio_db(mean_square: float) -> float:
    """PSNR in dB from the mean squared difference of code values 0..1."""
    return float("inf") if mean_square == 0 else float(-10 * np.log10(mean_square))


def channel_mean(image: np.ndarray) -> np.ndarray:
    """``(H, W, 3)`` -> ``(H, W)`` float32; numpy is slow along an axis of three."""
    return cv2.transform(np.ascontiguousarray(image, np.float32), np.full((1, 3), 1 / 3))


def _ssim_map(real: np.ndarray, synthetic: np.ndarray) -> np.ndarray:
    """``(H, W)`` local SSIM, mean over the channels: as scikit-image has it, in a third of its time."""
    real, synthetic = np.ascontiguousarray(real, np.float32), np.ascontiguousarray(synthetic, np.float32)
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


def _correlation(a: np.ndarray, b: np.ndarray) -> float:
    if a.std() == 0 or b.std() == 0:
        return float("nan")
    return float(np.corrcoef(a, b)[0, 1])


def _check(real: np.ndarray, synthetic: np.ndarray, mask: np.ndarray) -> None:
    if real.shape != synthetic.shape or mask.shape != real.shape[:2]:
        raise ValueError(f"expected images and mask of one size, found {real.shape}, {synthetic.shape}, {mask.shape}")
