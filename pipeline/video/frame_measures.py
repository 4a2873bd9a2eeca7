"""What one frame shows by itself: details, brightness, glare, what covers it, the black around it. Needs ``cv2``.

All measures are relative to the brightness of the frame, so that a camera's gain changes none of them.
"""

from dataclasses import dataclass

import cv2
import numpy as np

from ..images.highlights import highlights

GRID_WH = (16, 12)
"""Cells in which details are measured, across and down, so that those at the border of the view can be left out."""

_MOTION_GRID_WH = (8, 6)

VIEW_WIDTH = 160
"""Width in px of the small view in which foreign objects are looked for."""

BRIGHT_PERCENTILE, BRIGHT_LUMA = 98.0, 225.0
"""The brightest part of a frame, without highlights, is brought to this code value."""

BURNT_OUT = 250.0
"""Code value that the brightest part reaches in an overexposed frame."""

LIGHTNESS, GLARE_CHROMA = (25.0, 88.0), 16.0
"""In CIELAB: what is darker has no colour, and what is lighter and less coloured is glare."""

COLD_CHROMA = 8.0
"""Metal and gloves have less red and yellow than this (a* + b*); tissue, however pale, only in glare or in the dark."""

_WARM_TISSUE = 10.0
"""Tissue that is itself colder, or a film without colour: colour alone tells nothing."""

_COVERED_CELL = 0.1
"""Share of a cell from which on its details are those of what covers it."""

_MOTION_LUMA = 110.0

_LIT = 0.1
"""Share of the brightest part that is lit; what is darker is the black around the view."""

_STRONGEST_EDGE = 0.5
"""In units of the frame's brightness; highlights have stronger ones."""

DARK = 0.12
"""Brightness of the black around a view, relative to the median inside it."""

_LEAST_OUTSIDE = 0.01
"""Share of a picture that is black border, if there is one."""


@dataclass(frozen=True)
class FrameMeasures:
    """Measures of a frame.

    Attributes
    ----------
    details
        ``(12, 16)`` float16, contrast of edges in cells, relative to the brightness there; 0 where metal or gloves are.
    luma, bright
        Median code value of what is lit, and code value of :data:`BRIGHT_PERCENTILE`.
    covered, glare, highlights
        Shares of the picture, 0..1: metal and gloves; what is pale and light; what is lighter than all around it.
    motion
        Movement since the frame before, px of the view.
    """

    details: np.ndarray
    luma: float
    bright: float
    covered: float
    glare: float
    highlights: float
    motion: float


def measured(image: np.ndarray, previous: np.ndarray | None = None) -> FrameMeasures:
    """Measure an ``(H, W, 3)`` uint8 RGB image; ``previous`` is the view of the frame before, if there is one."""
    grey = cv2.cvtColor(image, cv2.COLOR_RGB2GRAY)
    view = view_of(image)
    luma, bright = _levels(cv2.cvtColor(view, cv2.COLOR_RGB2GRAY))
    cold, glare = foreign(view)
    smooth = cv2.GaussianBlur(grey, (3, 3), 0)
    across, down = (cv2.Sobel(smooth, cv2.CV_32F, *order, scale=1 / 8) for order in ((1, 0), (0, 1)))
    energy = np.minimum(across * across + down * down, (_STRONGEST_EDGE * luma) ** 2)
    energy, brightness, covered = (
        cv2.resize(values.astype(np.float32), GRID_WH, interpolation=cv2.INTER_AREA) for values in (energy, grey, cold)
    )
    details = np.sqrt(energy / (brightness**2 + (0.2 * luma) ** 2))
    details[covered > _COVERED_CELL] = 0
    motion = 0.0 if previous is None else motion_px(view, previous)
    white = highlights(view / np.float32(255))
    shares = float(cold.mean()), float(glare.mean()), float(white.mean())
    return FrameMeasures(details.astype(np.float16), luma, bright, *shares, motion)


def foreign(view: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Where a uint8 RGB view shows metal or gloves, and where glare, by their colour: ``(h, w)`` bool each."""
    bright = _levels(cv2.cvtColor(view, cv2.COLOR_RGB2GRAY))[1]
    lab = cv2.cvtColor(cv2.convertScaleAbs(view, alpha=BRIGHT_LUMA / bright), cv2.COLOR_RGB2LAB).astype(np.float32)
    lightness, red, yellow = lab[..., 0] * (100 / 255), lab[..., 1] - 128, lab[..., 2] - 128
    glare = (lightness > LIGHTNESS[1]) & (np.hypot(red, yellow) < GLARE_CHROMA)
    warmth, is_light = red + yellow, (lightness > LIGHTNESS[0]) & (lightness < LIGHTNESS[1])
    if not is_light.any() or np.median(warmth[is_light]) < _WARM_TISSUE:
        return np.zeros(glare.shape, np.bool_), glare
    cold = (warmth < COLD_CHROMA) & is_light & ~glare
    # a thin instrument is whole with its own highlights only
    opened = cv2.morphologyEx((cold | glare).astype(np.uint8), cv2.MORPH_OPEN, np.ones((3, 3), np.uint8)) > 0
    return opened & cold & ~glare, glare


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


def motion_px(view: np.ndarray, previous: np.ndarray) -> float:
    """How far the picture moved between two views, in px of the view: the normal flow, median over cells."""
    greys = (cv2.cvtColor(image, cv2.COLOR_RGB2GRAY) for image in (view, previous))
    one, other = (grey.astype(np.float32) * (_MOTION_LUMA / _levels(grey)[0]) for grey in greys)
    change = cv2.resize(np.abs(one - other), _MOTION_GRID_WH, interpolation=cv2.INTER_AREA)
    slope = cv2.magnitude(
        cv2.Sobel(other, cv2.CV_32F, 1, 0, scale=1 / 8), cv2.Sobel(other, cv2.CV_32F, 0, 1, scale=1 / 8)
    )
    return float(np.median(change / (cv2.resize(slope, _MOTION_GRID_WH, interpolation=cv2.INTER_AREA) + 1.0)))


def lit_part(brightness: np.ndarray) -> np.ndarray | None:
    """``(h, w)`` bool: where the optics let light through; ``None`` if there is no black border.

    Parameters
    ----------
    brightness
        ``(h, w)`` mean over the film.
    """
    dark = brightness < DARK * _lit_level(brightness)
    count, labels = cv2.connectedComponents(dark.astype(np.uint8), connectivity=4)
    border = np.unique(np.concatenate([labels[0], labels[-1], labels[:, 0], labels[:, -1]]))
    outside = np.isin(labels, border[border > 0]) & dark
    if count < 2 or outside.mean() < _LEAST_OUTSIDE:
        return None
    # numbers and letters in the black
    inside = cv2.morphologyEx((~outside).astype(np.uint8), cv2.MORPH_OPEN, np.ones((5, 5), np.uint8))
    count, labels, stats, _ = cv2.connectedComponentsWithStats(inside, connectivity=4)
    if count < 2:
        return None
    part = (labels == 1 + int(np.argmax(stats[1:, cv2.CC_STAT_AREA]))).astype(np.uint8)
    # the optics' view is convex: what is dark at its edge is tissue; the line around a filled hull is a pixel too wide
    outline = cv2.findContours(part, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)[0][0]
    hull = cv2.fillConvexPoly(np.zeros_like(part), cv2.convexHull(outline), (1,))
    part |= cv2.erode(hull, cv2.getStructuringElement(cv2.MORPH_CROSS, (3, 3)))
    return part > 0 if part.mean() > 0.1 else None


def _lit_level(brightness: np.ndarray) -> float:
    """Typical brightness of what is lit."""
    lit = brightness[brightness > 0.25 * float(np.percentile(brightness, 95))]
    return float(np.median(lit)) if lit.size else 1.0
