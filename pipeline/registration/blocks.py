"""Blocks of the image: pixels err together within one, and independently of those in others."""

import numpy as np

BLOCK_PX = 32
"""Side of a block."""

SPREAD = 3.0
"""Factor of the standard deviations: neighbouring blocks, the surface and the aligned frame err together. Errors were 2
times as large as without it on eight frames of the sample, 3 to 5 times on 39 of "bloster", whose mesh is off by
millimetres."""


def blocks_of(pixels: np.ndarray) -> tuple[int, np.ndarray]:
    """How many blocks pixels ``(N, 2)`` lie in, and ``(N,)`` the number of each one's."""
    u, v = (pixels // BLOCK_PX).astype(int).T
    # one number a block: unique rows take ten times as long
    found, block = np.unique((v << 32) + u, return_inverse=True)
    return len(found), block


def robust_step(jacobian: np.ndarray, residuals: np.ndarray, pixels: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """A step of a fit, and its covariance, robust against errors shared within a block (Liang & Zeger 1986).

    Parameters
    ----------
    jacobian, residuals
        ``(N, 2, D)`` derivatives of predicted pixels by D parameters, and ``(N, 2)`` found minus predicted, px.
    pixels
        ``(N, 2)`` where they lie.

    Returns
    -------
    ``(D,)`` and ``(D, D)``.
    """
    # far residuals have little weight, as in the fit
    weight = 1 / (1 + (residuals**2).sum(axis=1)) ** 2
    weighted = jacobian * weight[:, None, None]
    normal = np.tensordot(weighted, jacobian, ((0, 1), (0, 1)))
    gradient = (weighted * residuals[:, :, None]).sum(axis=1)
    _, block = blocks_of(pixels)
    sums = np.stack([np.bincount(block, each) for each in gradient.T], axis=1)
    # mm and radians differ in size
    scale = 1 / np.sqrt(np.maximum(np.diag(normal), 1e-300))
    inverse = scale[:, None] * np.linalg.pinv(scale[:, None] * normal * scale, hermitian=True) * scale
    return inverse @ gradient.sum(axis=0), SPREAD**2 * inverse @ (sums.T @ sums) @ inverse
