"""Measures of edges, which a blurred view cannot win: SSIM rises with blur wherever two images are misregistered.

Needs ``cv2``.
"""

from dataclasses import dataclass

import cv2
import numpy as np

from ...images.pixel_values import mask_box
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
    sharpness
        Root mean square of the view's gradients over the photograph's: 1 is as sharp, below 1 is blurred.
    edge_f
        F-score of edges that have one within :data:`MATCH_PX` in the other image.
    edge_px
        Mean distance from an edge to the nearest one in the other image, both ways, px.
    """

    gradient_correlation: float
    sharpness: float
    edge_f: float
    edge_px: float


def edge_measures(real: np.ndarray, synthetic: np.ndarray, mask: np.ndarray) -> EdgeMeasures:
    """Compare the edges of ``(H, W, 3)`` images (code values 0..1) inside an ``(H, W)`` bool mask."""
    nothing = EdgeMeasures(*[float("nan")] * 4)
    if not mask.any():
        return nothing
    box = mask_box(mask)
    real, synthetic, mask = real[box], synthetic[box], mask[box]
    kernel = np.ones((2 * BORDER_PX + 1,) * 2, np.uint8)
    inside = cv2.erode(mask.astype(np.uint8), kernel, borderType=cv2.BORDER_CONSTANT, borderValue=(0,)) > 0
    if not inside.any():
        return nothing
    gradients = [_gradients(image) for image in (real, synthetic)]
    a, b = (np.concatenate([x[inside], y[inside]]).astype(float) for x, y in gradients)
    energies = float((a * a).sum()), float((b * b).sum())
    if min(energies) == 0:
        return nothing
    strengths = [np.hypot(x, y) for x, y in gradients]
    threshold = float(np.percentile(strengths[0][inside], EDGE_PERCENTILE))
    edges = [_edges(x, y, threshold) & inside for x, y in gradients]
    edge_f, edge_px = _matched(*edges)
    return EdgeMeasures(
        float((a * b).sum() / np.sqrt(energies[0] * energies[1])), float(np.sqrt(energies[1] / energies[0])),
        edge_f, edge_px,
    )  # fmt: skip


def _gradients(image: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """``(H, W)`` derivatives of the grey values along x and y, per pixel."""
    smooth = cv2.GaussianBlur(channel_mean(image), (0, 0), SCALE_PX)
    return cv2.Scharr(smooth, cv2.CV_32F, 1, 0, scale=1 / 32), cv2.Scharr(smooth, cv2.CV_32F, 0, 1, scale=1 / 32)


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
