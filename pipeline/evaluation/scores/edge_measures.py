"""Measures of edges, which a blurred view cannot win: SSIM rises with blur wherever two images are misregistered.

Needs ``cv2``.
"""

from dataclasses import dataclass
from typing import NamedTuple

import cv2
import numpy as np

from .similarity import channel_mean

SCALE_PX = 1.0
"""Standard deviation of the Gaussian whose derivatives are the gradients: noise of single pixels is no edge."""
BORDER_PX = 4
"""Pixels this close to the border of the compared part have gradients of the border."""
EDGE_PERCENTILE = 90.0
"""A gradient that this share of the photograph's pixels do not reach makes an edge, in both images."""
MATCH_PX = 2.0
FARTHEST_PX = 10.0
"""Larger distances between edges count as this one."""


@dataclass(frozen=True)
class EdgeMeasures:
    """Edges of a view against those of a photograph; NaN where there are none.

    Attributes
    ----------
    gradient_correlation
        Cosine between all gradient vectors of both images, -1..1.
    edge_f
        F-score of edges that have one within :data:`MATCH_PX` in the other image.
    edge_px
        Mean distance from an edge to the nearest one in the other image, both ways, px.
    """

    gradient_correlation: float
    edge_f: float
    edge_px: float


class Gradients(NamedTuple):
    """``(H, W)`` float32 derivatives of the grey values along x and y, per pixel."""

    x: np.ndarray
    y: np.ndarray

    @classmethod
    def of(cls, image: np.ndarray) -> "Gradients":
        """Those of an image, ``(H, W, 3)`` code values 0..1."""
        smooth = cv2.GaussianBlur(channel_mean(image), (0, 0), SCALE_PX)
        return cls(*(cv2.Scharr(smooth, cv2.CV_32F, *axis, scale=1 / 32) for axis in ((1, 0), (0, 1))))


def sharpness(real: Gradients, synthetic: Gradients, mask: np.ndarray) -> float:
    """Root mean square of the view's gradients over the photograph's inside an ``(H, W)`` bool mask.

    1 is as sharp, below 1 is blurred; NaN where one has none.
    """
    inside = _inside(mask)
    energies = [sum(cv2.norm(part, cv2.NORM_L2SQR, inside) for part in each) for each in (real, synthetic)]
    return float(np.sqrt(energies[1] / energies[0])) if min(energies) > 0 else float("nan")


def edge_measures(real: Gradients, synthetic: Gradients, mask: np.ndarray) -> EdgeMeasures:
    """Compare the edges of two images inside an ``(H, W)`` bool mask."""
    inside = _inside(mask) > 0
    a, b = (np.concatenate([each.x[inside], each.y[inside]]).astype(float) for each in (real, synthetic))
    energies = float(a @ a), float(b @ b)
    if min(energies) == 0:
        return EdgeMeasures(*[float("nan")] * 3)
    threshold = float(np.percentile(np.hypot(real.x[inside], real.y[inside]), EDGE_PERCENTILE))
    edges = [_edges(*each, threshold) & inside for each in (real, synthetic)]
    return EdgeMeasures(float(a @ b / np.sqrt(energies[0] * energies[1])), *_matched(*edges))


def _inside(mask: np.ndarray) -> np.ndarray:
    """``(H, W)`` uint8: 1 for the pixels of a mask that are not close to its border."""
    kernel = np.ones((2 * BORDER_PX + 1,) * 2, np.uint8)
    return cv2.erode(mask.astype(np.uint8), kernel, borderType=cv2.BORDER_CONSTANT, borderValue=(0,))


def _edges(x: np.ndarray, y: np.ndarray, threshold: float) -> np.ndarray:
    """``(H, W)`` bool: Canny's edges with this upper threshold, and half of it as the lower one."""
    largest = 2**15 - 1
    factor = largest / max(float(np.abs(x).max()), float(np.abs(y).max()), 1e-12)
    scaled = [np.rint(part * factor).astype(np.int16) for part in (x, y)]
    return cv2.Canny(scaled[0], scaled[1], threshold * factor / 2, threshold * factor, L2gradient=True) > 0


def _matched(real: np.ndarray, synthetic: np.ndarray) -> tuple[float, float]:
    """F-score, and mean distance in px, of edges given as ``(H, W)`` bool."""
    if not real.any() and not synthetic.any():
        return float("nan"), float("nan")
    if not (real.any() and synthetic.any()):
        return 0.0, FARTHEST_PX
    to_real, to_synthetic = (
        cv2.distanceTransform((~edges).astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
        for edges in (real, synthetic)
    )
    found, missed = to_real[synthetic], to_synthetic[real]
    precision, recall = float((found <= MATCH_PX).mean()), float((missed <= MATCH_PX).mean())
    score = 0.0 if precision + recall == 0 else 2 * precision * recall / (precision + recall)
    distances = [float(np.minimum(each, FARTHEST_PX).mean()) for each in (found, missed)]
    return score, sum(distances) / 2
