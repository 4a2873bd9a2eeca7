"""Similarity of two views over the surface that both show. Needs scikit-image."""

from dataclasses import dataclass

import numpy as np
from skimage.metrics import structural_similarity

WINDOW_PX = 7
"""Side of SSIM's window (Wang et al. 2004; scikit-image's default)."""


@dataclass(frozen=True)
class Similarity:
    """Similarity of two images over a mask.

    Attributes
    ----------
    ssim
        Mean structural similarity over the mask, windows that leave the mask included.
    mean_error
        Mean absolute difference of code values, 0..255.
    correlation
        Pearson correlation of grey values: unlike the others, invariant to brightness and contrast.
    pixels
        Pixels of the mask.
    """

    ssim: float
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
    if real.shape != synthetic.shape or mask.shape != real.shape[:2]:
        raise ValueError(f"expected images and mask of one size, found {real.shape}, {synthetic.shape}, {mask.shape}")
    if not mask.any():
        raise ValueError("expected a mask with pixels in it, found an empty one")
    shown = np.where(mask[..., None], synthetic, real)
    _, ssim = structural_similarity(real, shown, win_size=WINDOW_PX, channel_axis=2, data_range=1.0, full=True)
    grey_real, grey_synthetic = real[mask].mean(axis=1), synthetic[mask].mean(axis=1)
    return Similarity(
        ssim=float(ssim[mask].mean()),
        mean_error=float(np.abs(real - synthetic)[mask].mean() * 255),
        correlation=float(np.corrcoef(grey_real, grey_synthetic)[0, 1]),
        pixels=int(np.count_nonzero(mask)),
    )
