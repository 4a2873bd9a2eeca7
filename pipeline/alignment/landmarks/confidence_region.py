"""The F distribution with an even number of degrees of freedom above: closed forms, no scipy.

With d1 = 2a and x = d1 f / (d1 f + d2) the probability to exceed f is the finite sum

    (1 - x)^b  sum_{j < a} x^j  b (b + 1) ... (b + j - 1) / j!,    b = d2 / 2

(the regularised incomplete beta function at an integer, Abramowitz & Stegun 26.6.4). d2 need not be whole.
"""

import math

import numpy as np


def f_survival(value: float, above: int, below: float) -> float:
    """Probability that F(above, below) exceeds a value >= 0; ``above`` is even."""
    if not math.isfinite(value):
        return 0.0
    fraction, half = above * value / (above * value + below), below / 2
    term = total = 1.0
    for j in range(1, above // 2):
        term *= fraction * (half + j - 1) / j
        total += term
    return (1 - fraction) ** half * total


def f_quantile(level: float, above: int, below: float) -> float:
    """The value that F(above, below) stays under with probability ``level``, 0 < level < 1; ``above`` is even."""
    lower, upper = 0.0, 1.0
    while f_survival(upper, above, below) > 1 - level:
        lower, upper = upper, 2 * upper
    for _ in range(100):
        middle = 0.5 * (lower + upper)
        if f_survival(middle, above, below) > 1 - level:
            lower = middle
        else:
            upper = middle
    return 0.5 * (lower + upper)


def ellipse_outlines(covariances: np.ndarray, scale: float, corners: int = 48) -> np.ndarray:
    """``(N, 2, 2)`` covariances -> ``(N, corners, 2)`` outlines about the origin.

    The points d with d^T C^-1 d = scale^2; a covariance that is singular gives a stroke.
    """
    values, vectors = np.linalg.eigh(covariances)
    roots = vectors * np.sqrt(np.maximum(values, 0.0))[:, None, :]
    angle = np.linspace(0, 2 * np.pi, corners, endpoint=False)
    circle = scale * np.stack([np.cos(angle), np.sin(angle)])
    return np.swapaxes(roots @ circle, -1, -2)
