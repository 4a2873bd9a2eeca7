"""How well pictures follow features, whatever the mixture of either: canonical correlation (Hotelling 1936).

With one channel it is the correlation ratio of linear regression; with three it also finds the colour in which the
features show best.
"""

from typing import NamedTuple

import numpy as np

RIDGE = 1e-4
"""Of the mean variance, added to each: features that are constant or alike must not decide."""


class CanonicalCorrelation(NamedTuple):
    """The mixtures of channels and of features that follow each other best.

    Attributes
    ----------
    score
        Squared correlation of the two, 0..1.
    channel_weights, feature_weights
        ``(C,)`` and ``(K,)`` so that ``channels @ channel_weights`` is nearest to ``features @ feature_weights`` but
        for a constant; the former has variance one.
    """

    score: float
    channel_weights: np.ndarray
    feature_weights: np.ndarray


def best_mixture(channels: np.ndarray, features: np.ndarray, weights: np.ndarray) -> CanonicalCorrelation:
    """Canonical correlation of ``(N, C)`` channels and ``(N, K)`` features with ``(N,)`` weights >= 0."""
    total = max(float(weights.sum()), 1e-12)
    y, p = channels - weights @ channels / total, features - weights @ features / total
    weighted = p * weights[:, None]
    within_p, between = weighted.T @ p / total, weighted.T @ y / total
    within_y = (y * weights[:, None]).T @ y / total
    inverse_root = np.linalg.inv(np.linalg.cholesky(_ridged(within_y)))
    regression = np.linalg.solve(_ridged(within_p), between)
    values, vectors = np.linalg.eigh(inverse_root @ (between.T @ regression) @ inverse_root.T)
    channel_weights = inverse_root.T @ vectors[:, -1]
    # the sign of an eigenvector is arbitrary
    channel_weights *= np.sign(channel_weights.sum()) or 1.0
    return CanonicalCorrelation(float(np.clip(values[-1], 0, 1)), channel_weights, regression @ channel_weights)


def summed_correlation(within_y: np.ndarray, within_p: np.ndarray, between: np.ndarray) -> np.ndarray:
    """Sum of the squared canonical correlations of many pairs of sets.

    Parameters
    ----------
    within_y, within_p, between
        ``(..., C, C)``, ``(..., K, K)`` and ``(..., K, C)`` covariances.
    """
    regression = np.linalg.solve(_ridged(within_p), between)
    explained = np.swapaxes(between, -1, -2) @ regression
    return np.trace(np.linalg.solve(_ridged(within_y), explained), axis1=-2, axis2=-1)


def _ridged(covariance: np.ndarray) -> np.ndarray:
    size = covariance.shape[-1]
    mean = np.trace(covariance, axis1=-2, axis2=-1) / size
    # features of different unit: a ridge of each one's own variance, and of the mean for the constant ones
    own = np.diagonal(covariance, axis1=-2, axis2=-1) * RIDGE + (RIDGE**2 * mean + 1e-30)[..., None]
    return covariance + own[..., None] * np.eye(size)
