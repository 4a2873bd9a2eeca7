"""The noise of a frame, and the frame without it. Needs cv2."""

import cv2
import numpy as np

LEAST_NOISE, STRENGTH = 5.0, 0.5
"""Noise from which on non-local means win more than the texture that they cost, code values; their strength relative
to it. Measured on held-out photographs: see docs/measurements.md."""
_LAPLACIANS = np.array([[1, -2, 1], [-2, 4, -2], [1, -2, 1]], np.float32) / 6


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
