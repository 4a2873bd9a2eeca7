"""Images without their light: what is left is comparable between exposures, lamps and haze."""

import cv2
import numpy as np

SIGMA = 0.03
"""Of the neighbourhood, relative to the longer side."""

SHRINK = 4
"""Factor by which images are made smaller to blur them widely."""


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
