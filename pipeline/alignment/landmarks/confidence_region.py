"""Confidence regions of a normal estimate with an estimated variance: their size and their outline in the image.

d^T C^-1 d / d1 of the deviation d in d1 dimensions, with a covariance C whose scale was estimated with d2 degrees of
freedom, follows F(d1, d2). The quantile of F is the size of the region; :func:`ellipse_outlines` draws it for d1 = 2.

Notes
-----
d1 is even here (2 for a pixel, 6 for a pose), which gives a closed form without scipy. With d1 = 2a and
x = d1 f / (d1 f + d2), the probability of exceeding f is the finite sum

    (1 - x)^b  sum_{j < a} x^j  b (b + 1) ... (b + j - 1) / j!,    b = d2 / 2

(the regularised incomplete beta function at an integer, Abramowitz & Stegun 26.6.4). d2 need not be an integer.
"""

import math

import numpy as np


def f_survival(value: float, numerator_dof: int, denominator_dof: float) -> float:
    """Probability that F(numerator_dof, denominator_dof) exceeds a value >= 0; ``numerator_dof`` is even."""
    if not math.isfinite(value):
        return 0.0
    scaled, half = numerator_dof * value, denominator_dof / 2
    fraction = scaled / (scaled + denominator_dof)
    term = total = 1.0
    for j in range(1, numerator_dof // 2):
        term *= fraction * (half + j - 1) / j
        total += term
    return (1 - fraction) ** half * total


def f_quantile(level: float, numerator_dof: int, denominator_dof: float) -> float:
    """The value that F(numerator_dof, denominator_dof) stays below with probability ``level``, 0 < level < 1.

    ``numerator_dof`` is even. Found by bisection of :func:`f_survival`.
    """
    lower, upper = 0.0, 1.0
    while f_survival(upper, numerator_dof, denominator_dof) > 1 - level:
        lower, upper = upper, 2 * upper
    for _ in range(100):
        middle = 0.5 * (lower + upper)
        if f_survival(middle, numerator_dof, denominator_dof) > 1 - level:
            lower = middle
        else:
            upper = middle
    return 0.5 * (lower + upper)


def ellipse_outlines(covariances: np.ndarray, scale: float, corners: int = 48) -> np.ndarray:
    """``(N, 2, 2)`` covariances C -> ``(N, corners, 2)`` outlines of their ellipses about the origin.

    The points d with d^T C^-1 d = scale^2; the ellipse of a singular covariance degenerates to a line segment.
    """
    values, vectors = np.linalg.eigh(covariances)
    roots = vectors * np.sqrt(np.maximum(values, 0.0))[:, None, :]
    angle = np.linspace(0, 2 * np.pi, corners, endpoint=False)
    circle = scale * np.stack([np.cos(angle), np.sin(angle)])
    return np.swapaxes(roots @ circle, -1, -2)
