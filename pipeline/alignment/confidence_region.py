"""The size of confidence regions of a normal estimate with an estimated variance.

d^T C^-1 d / d1 of the deviation d in d1 dimensions, with a covariance C whose scale was estimated with d2 degrees of
freedom, follows F(d1, d2). The quantile of F is the size of the region.

Notes
-----
d1 is even here (2 for a pixel, 6 for a pose), which gives a closed form: the add-on has no SciPy. With d1 = 2a and
x = d1 f / (d1 f + d2), the probability of exceeding f is the finite sum

    (1 - x)^b  sum_{j < a} x^j  b (b + 1) ... (b + j - 1) / j!,    b = d2 / 2

(the regularised incomplete beta function at an integer, Abramowitz & Stegun 26.6.4). d2 need not be an integer.
"""

import math
from collections.abc import Callable
from functools import lru_cache


def f_survival(value: float, numerator_dof: int, denominator_dof: float) -> float:
    """Probability that F(numerator_dof, denominator_dof) exceeds a value >= 0; ``numerator_dof`` is even."""
    if not math.isfinite(value):
        return 0.0
    if math.isinf(denominator_dof):
        return pooled_survival(value, numerator_dof, 0, 1)
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
    return _bisected(lambda value: f_survival(value, numerator_dof, denominator_dof) - (1 - level), 1.0)


def pooled_survival(value: float, numerator_dof: int, residual_dof: float, prior_dof: float) -> float:
    """Probability that a ratio with a partly known variance in its denominator exceeds a value >= 0.

    The ratio is (A / d1) / ((p + S) / (p + n)) with independent A ~ chi^2(d1), S ~ chi^2(n): the denominator pools n
    degrees of freedom of residuals with p of a variance that is known to be 1. Without p it follows F(d1, n).

    Parameters
    ----------
    value
        The ratio.
    numerator_dof, residual_dof, prior_dof
        d1, which is even; n and p, not both 0.

    Notes
    -----
    As A exceeds c with probability e^(-c/2) sum_{j < d1/2} (c/2)^j / j!, and S has E[S^m e^(-ys)] =
    2^m (n/2) (n/2 + 1) ... (n/2 + m - 1) / (1 + 2y)^(n/2 + m), the expectation over S is a finite sum.
    """
    y = 0.5 * numerator_dof * value / (prior_dof + residual_dof)
    half, total = residual_dof / 2, 0.0
    for j in range(numerator_dof // 2):
        moment = 1.0
        for m in range(j + 1):
            total += (
                math.comb(j, m) * (y * prior_dof) ** (j - m) * (2 * y / (1 + 2 * y)) ** m * moment / math.factorial(j)
            )
            moment *= half + m
    return math.exp(-y * prior_dof - half * math.log1p(2 * y)) * total


@lru_cache
def pooled_dof(level: float, numerator_dof: int, residual_dof: float, prior_dof: float) -> float:
    """The d2 with which F(d1, d2) has the quantile of probability ``level`` of :func:`pooled_survival`'s ratio."""
    quantile = _bisected(
        lambda value: pooled_survival(value, numerator_dof, residual_dof, prior_dof) - (1 - level), 1.0
    )
    return _bisected(lambda dof: f_survival(quantile, numerator_dof, dof) - (1 - level), 1.0)


def _bisected(decreasing: Callable[[float], float], upper: float) -> float:
    """Where a function that decreases from a positive value at 0 becomes zero."""
    lower = 0.0
    while decreasing(upper) > 0:
        lower, upper = upper, 2 * upper
    for _ in range(100):
        middle = 0.5 * (lower + upper)
        if decreasing(middle) > 0:
            lower = middle
        else:
            upper = middle
    return 0.5 * (lower + upper)
