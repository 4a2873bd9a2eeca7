"""Images without their light, whose share of what they show varies slowly: what is left is comparable.

Less its local mean, an image correlates with what a surface looks like under any broad light. Divided by its local
deviation too, it is comparable between exposures, lamps and haze.
"""

import cv2
import numpy as np

SIGMA = 0.03
"""Standard deviation of the neighbourhood of :func:`without_light`, relative to the longer side."""

SHRINK = 4
"""Factor by which images are made smaller to blur them widely."""

MAX_DEVIATION = 3.0
"""Bound on the deviation of an image from its local mean, in standard deviations."""


def without_light(grey: np.ndarray, mask: np.ndarray) -> np.ndarray:
    """``(H, W)`` uint8: the image less its local mean, by its local deviation; grey outside the mask."""
    sigma = SIGMA * max(grey.shape)
    weight = np.maximum(_blurred(mask.astype(np.float32), sigma), 1e-3)
    image = np.where(mask, grey, 0).astype(np.float32)
    detail = np.where(mask, grey - _blurred(image, sigma) / weight, 0).astype(np.float32)
    deviation = np.sqrt(np.maximum(_blurred(detail**2, sigma), 0) / weight)
    return np.clip(128 + 48 * detail / (deviation + 4), 0, 255).astype(np.uint8)


def _blurred(image: np.ndarray, sigma: float) -> np.ndarray:
    """A wide Gaussian blur, of a smaller image: it has no finer detail, and takes a tenth of the time."""
    height, width = image.shape
    small = cv2.resize(image, (-(-width // SHRINK), -(-height // SHRINK)), interpolation=cv2.INTER_AREA)
    small = cv2.GaussianBlur(small, (0, 0), sigma / SHRINK)
    return cv2.resize(small, (width, height), interpolation=cv2.INTER_LINEAR)


def without_local_mean(image: np.ndarray, mask: np.ndarray, window_px: float) -> np.ndarray:
    """``(H, W)`` or ``(H, W, C)`` less its Gaussian-weighted mean over the mask; float32, 0 outside the mask.

    The weights are those of the mask's pixels only (normalised convolution, Knutsson & Westin 1993).
    """
    result = _minus_local_mean(image, mask, window_px)
    result[~mask] = 0
    return result


def image_without_local_mean(image: np.ndarray, valid: np.ndarray, mask: np.ndarray, window_px: float) -> np.ndarray:
    """The image ``(H, W, C)`` less its local mean over ``mask & valid``, also beyond the mask; 0 outside ``valid``.

    Values are clipped to :data:`MAX_DEVIATION`, to limit the influence of highlights and instruments.
    """
    result = _minus_local_mean(image, mask & valid, window_px)
    result[~valid] = 0
    spread = np.sqrt(np.mean(result[mask & valid] ** 2, axis=0)) if (mask & valid).any() else 0.0
    return np.clip(result, -MAX_DEVIATION * spread, MAX_DEVIATION * spread).astype(np.float32)


def _minus_local_mean(image: np.ndarray, mask: np.ndarray, window_px: float) -> np.ndarray:
    weight = mask.astype(np.float32)
    total = np.maximum(cv2.GaussianBlur(weight, (0, 0), window_px, borderType=cv2.BORDER_CONSTANT), 1e-6)
    planes = image.astype(np.float32).reshape(*image.shape[:2], -1)
    mean = [
        cv2.GaussianBlur(plane * weight, (0, 0), window_px, borderType=cv2.BORDER_CONSTANT) / total
        for plane in np.moveaxis(planes, 2, 0)
    ]
    return (planes - np.dstack(mean)).reshape(image.shape)
