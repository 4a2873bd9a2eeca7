"""The sRGB transfer curve (IEC 61966-2-1): code values of a picture <-> linear light, both 0..1."""

import numpy as np


def linear_from_codes(codes: np.ndarray) -> np.ndarray:
    """Code values -> linear light, float64 of any shape."""
    codes = np.asarray(codes, dtype=np.float64)
    return np.where(codes <= 0.04045, codes / 12.92, ((np.maximum(codes, 0) + 0.055) / 1.055) ** 2.4)


def codes_from_linear(linear: np.ndarray) -> np.ndarray:
    """Linear light -> code values, float64 of any shape."""
    linear = np.asarray(linear, dtype=np.float64)
    return np.where(linear <= 0.0031308, linear * 12.92, 1.055 * np.maximum(linear, 0) ** (1 / 2.4) - 0.055)
