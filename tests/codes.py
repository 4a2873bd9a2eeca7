"""Code values of linear light, which only tests compute: Blender does it for the program."""

import numpy as np

from oneframe.images.transfer import SRGB, Transfer


def codes_from_linear(linear: np.ndarray, curve: Transfer = SRGB) -> np.ndarray:
    """Linear light -> code values, float64 of any shape."""
    linear = np.asarray(linear, dtype=np.float64)
    power = (1 + curve.shift) * np.maximum(linear, 0) ** (1 / curve.gamma) - curve.shift
    return np.where(linear <= curve.straight / curve.slope, linear * curve.slope, power)
