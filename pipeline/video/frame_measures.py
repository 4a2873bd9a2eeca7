"""What one frame shows by itself: its details, its brightness, its small view, its noise. Needs ``cv2``.

All measures are relative to the brightness of the frame, so that a camera's gain changes none of them.
"""

from dataclasses import dataclass

import cv2
import numpy as np

GRID_WH = (8, 6)
"""Cells in which sharpness is compared, across and down."""

DETAIL_WH = (48, 36)
"""Smaller cells in which details are measured, so that those at the border of the view can be left out."""

VIEW_WIDTH = 160
"""Width in px of the small view in which foreign objects are looked for."""

BRIGHT_PERCENTILE, BRIGHT_LUMA = 98.0, 225.0
"""The brightest part of a typical view, without highlights, is brought to this code value."""

BURNT_OUT = 250.0
"""Code value that the brightest part reaches in an overexposed frame."""

_MOTION_LUMA = 110.0

_LIT = 0.1
"""Share of the brightest part that is lit; what is darker is the black around the view."""

_STRONGEST_EDGE = 0.5
"""In units of the frame's brightness; highlights have stronger ones."""

LEAST_NOISE, STRENGTH = 5.0, 0.5
"""Noise from which on non-local means win more than the texture that they cost, code values; their strength relative
to it. Measured on held-out photographs: see docs/measurements.md."""
_LAPLACIANS = np.array([[1, -2, 1], [-2, 4, -2], [1, -2, 1]], np.float32) / 6


@dataclass(frozen=True)
class FrameMeasures:
    """Measures of a frame.

    Attributes
    ----------
    details
        ``(36, 48)`` float32, energy of the gradient in cells, relative to the brightness there.
    luma, bright
        Median code value of what is lit, and code value of :data:`BRIGHT_PERCENTILE`.
    view
        ``(h, w, 3)`` uint8 RGB, :data:`VIEW_WIDTH` wide.
    """

    details: np.ndarray
    luma: float
    bright: float
    view: np.ndarray


def measured(image: np.ndarray) -> FrameMeasures:
    """Measure an ``(H, W, 3)`` uint8 RGB image."""
    grey = cv2.cvtColor(image, cv2.COLOR_RGB2GRAY)
    view = view_of(image)
    luma, bright = _levels(cv2.cvtColor(view, cv2.COLOR_RGB2GRAY))
    smooth = cv2.GaussianBlur(grey, (3, 3), 0)
    across, down = (cv2.Sobel(smooth, cv2.CV_32F, *order, scale=1 / 8) for order in ((1, 0), (0, 1)))
    energy = np.minimum(across * across + down * down, (_STRONGEST_EDGE * luma) ** 2)
    brightness = cv2.resize(grey.astype(np.float32), DETAIL_WH, interpolation=cv2.INTER_AREA)
    details = cv2.resize(energy, DETAIL_WH, interpolation=cv2.INTER_AREA) / (brightness**2 + (0.2 * luma) ** 2)
    return FrameMeasures(details, luma, bright, view)


def _levels(grey: np.ndarray) -> tuple[float, float]:
    """Median of what is lit, and the brightest part without highlights."""
    counts = np.bincount(grey.ravel(), minlength=256)
    bright = int(np.searchsorted(np.cumsum(counts), BRIGHT_PERCENTILE / 100 * grey.size))
    dark = int(_LIT * bright)
    counts[:dark] = 0
    total = np.cumsum(counts)
    # between codes, so that a gain of the camera does not come out in steps
    half = float(total[-1]) / 2
    luma = int(np.searchsorted(total, half))
    before = int(total[luma - 1]) if luma else 0
    return max(luma - 0.5 + (half - before) / max(int(counts[luma]), 1), 1.0), max(float(bright), 1.0)


def view_of(image: np.ndarray) -> np.ndarray:
    """The small view of an ``(H, W, 3)`` uint8 image."""
    height, width = image.shape[:2]
    if width <= VIEW_WIDTH:
        return image
    return cv2.resize(image, (VIEW_WIDTH, max(1, round(height * VIEW_WIDTH / width))), interpolation=cv2.INTER_AREA)


def normalised_lab(view: np.ndarray, gain: float) -> np.ndarray:
    """``(h, w, 3)`` float32 CIELAB of a uint8 RGB view whose code values are multiplied by ``gain``."""
    lab = cv2.cvtColor(cv2.convertScaleAbs(view, alpha=gain), cv2.COLOR_RGB2LAB).astype(np.float32)
    lab[..., 0] *= 100 / 255
    lab[..., 1:] -= 128
    return lab


def local_contrast(view: np.ndarray) -> np.ndarray:
    """``(h, w)`` uint8: brightness relative to its surroundings, whatever gain and vignetting are."""
    grey = cv2.cvtColor(view, cv2.COLOR_RGB2GRAY).astype(np.float32)
    difference = grey - cv2.GaussianBlur(grey, (0, 0), 6)
    spread = cv2.GaussianBlur(np.abs(difference), (0, 0), 12)
    floor = 0.015 * max(float(grey.mean()), 1.0)
    return np.clip(128 + 45 * difference / (spread + floor), 0, 255).astype(np.uint8)


def motion_px(view: np.ndarray, previous: np.ndarray) -> float:
    """How far the picture moved between two views, in px of the view: the normal flow, median over cells."""
    greys = (cv2.cvtColor(image, cv2.COLOR_RGB2GRAY) for image in (view, previous))
    one, other = (grey.astype(np.float32) * (_MOTION_LUMA / _levels(grey)[0]) for grey in greys)
    change = cv2.resize(np.abs(one - other), GRID_WH, interpolation=cv2.INTER_AREA)
    slope = cv2.magnitude(
        cv2.Sobel(other, cv2.CV_32F, 1, 0, scale=1 / 8), cv2.Sobel(other, cv2.CV_32F, 0, 1, scale=1 / 8)
    )
    return float(np.median(change / (cv2.resize(slope, GRID_WH, interpolation=cv2.INTER_AREA) + 1.0)))


def noise_of(codes: np.ndarray, shown: np.ndarray) -> float:
    """Standard deviation of the noise in ``(H, W, 3)`` codes where they show something, code values.

    Of the difference of two Laplacians, to which edges and slopes add little, by the median. Source: Immerkær, Fast
    noise variance estimation, Computer Vision and Image Understanding 64 (1996).
    """
    return float(np.median(np.abs(cv2.filter2D(codes.astype(np.float32), -1, _LAPLACIANS)[shown])) / 0.6745)


def denoised(codes: np.ndarray, shown: np.ndarray) -> tuple[np.ndarray | None, str]:
    """``(H, W, 3)`` uint8 codes without the noise that they have where shown, or ``None`` to leave them; and a text."""
    noise = noise_of(codes, shown)
    if noise < LEAST_NOISE:
        return None, f"noise of {noise:.1f} code values, too little to remove without loss: the colours stay"
    strength = STRENGTH * noise
    found = cv2.fastNlMeansDenoisingColored(codes, None, strength, strength, 7, 21)
    return found, f"noise of {noise:.1f} code values removed"
