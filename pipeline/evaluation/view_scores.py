"""All scores of one view against the photograph of its pose. Needs ``cv2`` and ``skimage``."""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from skimage.metrics import structural_similarity

from ..images.pixel_values import mask_box

DARKEST, BRIGHTEST = 10 / 255, 250 / 255
"""Code values beyond these are noise or saturated and say nothing about a factor."""
FEWEST_USABLE = 50
MOST_PIXELS = 50_000
"""More make the estimate slower, not better: its error is that of shading and alignment."""
TUKEY = 4.685
"""Cut-off of Tukey's biweight in standard deviations: 95 % efficiency for normal errors (Huber, Robust Statistics)."""
MAD_TO_SIGMA = 1.4826
ROUNDS = 20

WINDOW_PX = 7
"""Side of SSIM's window (Wang et al. 2004; scikit-image's default)."""


def colour_gain(real: np.ndarray, synthetic: np.ndarray, mask: np.ndarray) -> np.ndarray:
    """The factor ``(3,)`` by which the view's code values must be multiplied to match the photograph's.

    The centre of the logarithmic ratios by Tukey's biweight from their median: it tolerates highlights, occluders and
    unpainted surface on up to half of the pixels, and does not favour a blurred view as a least-squares fit would.

    Parameters
    ----------
    real, synthetic
        ``(H, W, 3)`` code values 0..1.
    mask
        ``(H, W)`` bool: the pixels to compare.

    Returns
    -------
    The factors; NaN if fewer than :data:`FEWEST_USABLE` pixels are usable.
    """
    inside = np.flatnonzero(mask)
    v, u = np.unravel_index(inside[:: max(len(inside) // MOST_PIXELS, 1)], mask.shape)
    a, b = real[v, u], synthetic[v, u]
    return np.array([_gain(a[:, channel], b[:, channel]) for channel in range(3)])


def _gain(real: np.ndarray, synthetic: np.ndarray) -> float:
    usable = (real > DARKEST) & (real < BRIGHTEST) & (synthetic > DARKEST) & (synthetic < BRIGHTEST)
    if np.count_nonzero(usable) < FEWEST_USABLE:
        return float("nan")
    ratios = np.log(real[usable].astype(float) / synthetic[usable])
    centre = float(np.median(ratios))
    # at least the width of a code value, else equal images leave no width at all
    width = max(MAD_TO_SIGMA * float(np.median(np.abs(ratios - centre))), 1 / 255)
    for _ in range(ROUNDS):
        weights = np.clip(1 - ((ratios - centre) / (TUKEY * width)) ** 2, 0, None) ** 2
        centre = float((weights * ratios).sum() / weights.sum())
    return float(np.exp(centre))


def corrected(synthetic: np.ndarray, gain: np.ndarray) -> np.ndarray:
    """``(H, W, 3)`` code values with the gain applied, clipped to 0..1; unchanged where the gain is NaN."""
    factors = np.where(np.isfinite(gain), gain, 1.0).astype(np.float32)
    return np.clip(synthetic * factors, 0, 1)


SCORES = {
    "angle_deg": "angle around the surface from the nearest frame, degrees",
    "surface_px": "pixels that show the surface",
    "observed_px": "pixels that show surface that the frame saw",
    "gain_red": "factor from the view to the photograph, red",
    "gain_green": "factor from the view to the photograph, green",
    "gain_blue": "factor from the view to the photograph, blue",
    "ssim_whole": "SSIM of the whole image, black outside the surface (the paper's protocol)",
    "ssim_surface": "SSIM inside the surface",
    "ssim_observed": "SSIM inside the surface that the frame saw",
    "psnr_whole": "PSNR of the whole image, dB",
    "psnr_surface": "PSNR inside the surface, dB",
    "psnr_observed": "PSNR inside the observed surface, dB",
    "error_surface": "mean absolute error inside the surface, /255",
    "error_observed": "mean absolute error inside the observed surface, /255",
    "ssim_whole_corrected": "SSIM of the whole image after correction of exposure and colour",
    "ssim_surface_corrected": "SSIM inside the surface after the correction",
    "ssim_observed_corrected": "SSIM inside the observed surface after the correction",
    "psnr_whole_corrected": "PSNR of the whole image after the correction, dB",
    "psnr_surface_corrected": "PSNR inside the surface after the correction, dB",
    "psnr_observed_corrected": "PSNR inside the observed surface after the correction, dB",
    "error_surface_corrected": "mean absolute error inside the surface after the correction, /255",
    "error_observed_corrected": "mean absolute error inside the observed surface after the correction, /255",
}
"""The scores of a view, in the order of the table -> what they mean."""

HIGHER_IS_BETTER = ("ssim", "psnr")
LOWER_IS_BETTER = ("error",)
"""Beginnings of names of scores of which more, or less, is better; the others describe views and poses."""
FEWEST_PIXELS = 64
"""A part of the image below this size is not scored: a window of SSIM has 49 pixels."""


def scores_of(real: np.ndarray, synthetic: np.ndarray, surface: np.ndarray, observed: np.ndarray) -> dict[str, float]:
    """Score a view.

    Parameters
    ----------
    real, synthetic
        The photograph and the view: ``(H, W, 3)`` float32 code values 0..1.
    surface, observed
        ``(H, W)`` bool: pixels that show surface, and surface that the source frame saw; the same for all methods.

    Returns
    -------
    A value for each of :data:`SCORES`; NaN where it has none, since the part of the image is missing or uniform, and
    for the angle, which images do not tell.
    """
    values = dict.fromkeys(SCORES, float("nan"))
    values["surface_px"], values["observed_px"] = map(float, (np.count_nonzero(surface), np.count_nonzero(observed)))
    if values["surface_px"] < FEWEST_PIXELS:
        return values
    everything, box = surface.size, mask_box(surface, WINDOW_PX)
    real, synthetic, surface, observed = (each[box] for each in (real, synthetic, surface, observed))
    seen = values["observed_px"] >= FEWEST_PIXELS
    parts = {"surface": surface, "observed": observed} if seen else {"surface": surface}
    gain = colour_gain(real, synthetic, observed if seen else surface)
    values["gain_red"], values["gain_green"], values["gain_blue"] = map(float, gain)
    matched = corrected(synthetic, gain)
    for image, suffix in ((synthetic, ""), (matched, "_corrected")):
        whole, found = whole_and_parts(real, image, list(parts.values()), everything)
        values["ssim_whole" + suffix], values["psnr_whole" + suffix] = whole
        for part, each in zip(parts, found, strict=True):
            values[f"ssim_{part}{suffix}"], values[f"psnr_{part}{suffix}"] = each.ssim, each.psnr
            values[f"error_{part}{suffix}"] = each.mean_error
    return values


def direction(score: str) -> int:
    """1 if more of a score is better, -1 if less is, 0 if neither."""
    return int(score.startswith(HIGHER_IS_BETTER)) - int(score.startswith(LOWER_IS_BETTER))


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


def _ssim_map(real: np.ndarray, synthetic: np.ndarray) -> np.ndarray:
    """``(H, W)`` local SSIM, mean over the channels."""
    _, found = structural_similarity(real, synthetic, win_size=WINDOW_PX, channel_axis=2, data_range=1.0, full=True)
    return found.mean(axis=2)
