"""Distances between two sets of images, from the features that a network gives them: FID and KID.

FID (Heusel et al. 2017) is biased: it falls with the number of images, so only values of equal numbers compare, and
below :data:`FID_IMAGES` images not even those say much. KID (Bińkowski et al. 2018) is unbiased for any number, and has
a standard error.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

FID_IMAGES = 2048
"""With fewer images than features the covariances of FID are singular; its authors demand at least this number."""
FEWEST_IMAGES = 3
"""Least size of each set; fewer have no covariance, or no standard error."""


@dataclass(frozen=True)
class KernelDistance:
    """KID and its standard error (NaN for fewer than three images)."""

    kid: float
    standard_error: float


def frechet_distance(a: np.ndarray, b: np.ndarray) -> float:
    """FID: the squared Fréchet distance of two normal distributions fitted to ``(N, D)`` and ``(M, D)`` features.

    Raises
    ------
    ValueError
        Fewer than two images in a set, or features of different numbers.

    Notes
    -----
    The trace of the square root of the product of both covariances is the sum of the singular values of ``A B^T``, with
    A and B the centred features over the square root of their degrees of freedom. So nothing is inverted, and no root
    of a singular matrix is taken.
    """
    _check(a, b, 2)
    a, b = a.astype(float), b.astype(float)
    means = a.mean(axis=0), b.mean(axis=0)
    centred = [(part - mean) / np.sqrt(len(part) - 1) for part, mean in zip((a, b), means, strict=True)]
    root = np.linalg.svd(centred[0] @ centred[1].T, compute_uv=False).sum()
    variances = sum(float((part**2).sum()) for part in centred)
    return float(((means[0] - means[1]) ** 2).sum() + variances - 2 * root)


def kernel_distance(a: np.ndarray, b: np.ndarray) -> KernelDistance:
    """KID: the unbiased squared maximum mean discrepancy of ``(N, D)`` features, kernel ``(x.y / D + 1)^3``.

    Row i of both sets belongs to one photograph and its view. The standard error is that of a jackknife which leaves
    out one such pair at a time, so it takes into account that they resemble each other. It is never too small on
    average (Efron and Stein 1981): for sets that differ it is right, for equal distributions 1.4 times too large.

    Raises
    ------
    ValueError
        Sets of different shapes, or of fewer than two images.
    """
    _check(a, b, 2)
    if len(a) != len(b):
        raise ValueError(f"expected as many views as photographs, found {len(a)} and {len(b)}")
    a, b = a.astype(float), b.astype(float)
    within_a, within_b, between = _kernel(a, a), _kernel(b, b), _kernel(a, b)
    for within in (within_a, within_b):
        np.fill_diagonal(within, 0)
    count = len(a)
    kid = _unbiased(within_a.sum(), within_b.sum(), between.sum(), count)
    if count < FEWEST_IMAGES:
        return KernelDistance(float(kid), float("nan"))
    left = _unbiased(
        within_a.sum() - 2 * within_a.sum(axis=1),
        within_b.sum() - 2 * within_b.sum(axis=1),
        between.sum() - between.sum(axis=0) - between.sum(axis=1) + np.diagonal(between),
        count - 1,
    )
    variance = (count - 1) / count * float(((left - left.mean()) ** 2).sum())
    return KernelDistance(float(kid), float(np.sqrt(variance)))


def _kernel(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return (a @ b.T / a.shape[1] + 1) ** 3


def _unbiased(within_a: ArrayLike, within_b: ArrayLike, between: ArrayLike, count: int) -> np.ndarray:
    """From the sums of the kernel over all pairs, without those of an image with itself in ``within``."""
    return np.add(within_a, within_b) / (count * (count - 1)) - 2 * np.asarray(between) / count**2


def _check(a: np.ndarray, b: np.ndarray, fewest: int) -> None:
    if a.ndim != 2 or b.ndim != 2 or a.shape[1] != b.shape[1]:
        raise ValueError(f"expected two sets of as many features, found {a.shape} and {b.shape}")
    if min(len(a), len(b)) < fewest:
        raise ValueError(f"expected at least {fewest} images in each set, found {len(a)} and {len(b)}")
