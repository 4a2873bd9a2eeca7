"""Outlines of the ellipses that covariances describe."""

import numpy as np


def ellipse_outlines(covariances: np.ndarray, scale: float, corners: int = 48) -> np.ndarray:
    """``(N, 2, 2)`` covariances -> ``(N, corners, 2)`` outlines about the origin.

    The points d with d^T C^-1 d = scale^2; a covariance that is singular gives a stroke.
    """
    values, vectors = np.linalg.eigh(covariances)
    roots = vectors * np.sqrt(np.maximum(values, 0.0))[:, None, :]
    angle = np.linspace(0, 2 * np.pi, corners, endpoint=False)
    circle = scale * np.stack([np.cos(angle), np.sin(angle)])
    return np.swapaxes(roots @ circle, -1, -2)
