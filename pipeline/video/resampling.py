"""Frames of a film resampled, all in the same way. Needs ``cv2``."""

import cv2
import numpy as np


class Resampler:
    """Samples each frame at given places, bilinearly; they are prepared once."""

    def __init__(self, pixels: np.ndarray) -> None:
        """Sample at ``(H, W, 2)`` pixels (x, y) of a frame; black outside it."""
        self._across, self._down = (np.ascontiguousarray(pixels[..., axis], np.float32) for axis in (0, 1))

    def __call__(self, image: np.ndarray) -> np.ndarray:
        """``(h, w, 3)`` uint8 -> ``(H, W, 3)`` uint8."""
        return np.asarray(
            cv2.remap(image, self._across, self._down, interpolation=cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT)
        )
