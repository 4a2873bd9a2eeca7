"""Canonical correlation (Hotelling 1936) of an image's channels and the features of a surface.

It is the largest correlation of a linear combination of the channels with one of the features, and so needs no model of
albedo or light. With one channel its square is the R^2 of linear regression; with three it also finds the colour in
which the features show best.
"""

from typing import NamedTuple

import numpy as np

RIDGE = 1e-4
"""Relative to each variance: the regularisation against constant and collinear features."""


class CanonicalCorrelation(NamedTuple):
    """The linear combinations ("mixtures") of channels and of features that correlate best.

    Attributes
    ----------
    score
        Squared correlation of the two mixtures, 0..1.
    channel_weights, feature_weights
        ``(C,)`` and ``(K,)``: ``channels @ channel_weights`` has variance one; ``features @ feature_weights`` is its
        linear regression, up to a constant.
    """

    score: float
    channel_weights: np.ndarray
    feature_weights: np.ndarray


def best_mixture(channels: np.ndarray, features: np.ndarray, weights: np.ndarray) -> CanonicalCorrelation:
    """First canonical correlation of ``(N, C)`` channels and ``(N, K)`` features with ``(N,)`` weights >= 0."""
    total = max(float(weights.sum()), 1e-12)
    y, p = channels - weights @ channels / total, features - weights @ features / total
    weighted = p * weights[:, None]
    within_p, between = weighted.T @ p / total, weighted.T @ y / total
    within_y = (y * weights[:, None]).T @ y / total
    inverse_root = np.linalg.inv(np.linalg.cholesky(_regularised(within_y)))
    regression = np.linalg.solve(_regularised(within_p), between)
    values, vectors = np.linalg.eigh(inverse_root @ (between.T @ regression) @ inverse_root.T)
    channel_weights = inverse_root.T @ vectors[:, -1]
    # the sign of an eigenvector is arbitrary
    channel_weights *= np.sign(channel_weights.sum()) or 1.0
    return CanonicalCorrelation(float(np.clip(values[-1], 0, 1)), channel_weights, regression @ channel_weights)


def summed_correlation(within_y: np.ndarray, within_p: np.ndarray, between: np.ndarray) -> np.ndarray:
    """Sum of the squared canonical correlations, ``(...)``, from covariances.

    ``(..., C, C)`` of the channels, ``(..., K, K)`` of the features, ``(..., K, C)`` between them.
    """
    regression = np.linalg.solve(_regularised(within_p), between)
    explained = np.swapaxes(between, -1, -2) @ regression
    return np.trace(np.linalg.solve(_regularised(within_y), explained), axis1=-2, axis2=-1)


def _regularised(covariance: np.ndarray) -> np.ndarray:
    size = covariance.shape[-1]
    mean = np.trace(covariance, axis1=-2, axis2=-1) / size
    # features differ in unit: each gets a ridge of its own variance, and of the mean variance in case it is constant
    own = np.diagonal(covariance, axis1=-2, axis2=-1) * RIDGE + (RIDGE**2 * mean + 1e-30)[..., None]
    return covariance + own[..., None] * np.eye(size)
