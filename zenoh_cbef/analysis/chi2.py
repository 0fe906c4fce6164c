"""Quantiles of the chi-squared distribution, for the consistency bands."""

from __future__ import annotations

from functools import lru_cache
from math import exp, lgamma, log, sqrt
from statistics import NormalDist


def chi2_cdf(value: float, degrees: float) -> float:
    """P(X <= value): the regularised lower incomplete gamma function by its power series."""
    if value <= 0.0:
        return 0.0
    shape, half = 0.5 * degrees, 0.5 * value
    term = total = 1.0 / shape
    count = shape
    while term > total * 1e-17:
        count += 1.0
        term *= half / count
        total += term
    return min(1.0, total * exp(shape * log(half) - half - lgamma(shape)))


@lru_cache(maxsize=4096)
def chi2_quantile(probability: float, degrees: float) -> float:
    """The value that X stays below with a probability, by bisection from the Wilson-Hilferty estimate."""
    spread = 2.0 / (9.0 * degrees)
    guess = degrees * max(1e-3, 1.0 - spread + NormalDist().inv_cdf(probability) * sqrt(spread)) ** 3
    low, high = 0.0, 2.0 * guess + 10.0
    while high - low > 1e-12 * high:
        middle = 0.5 * (low + high)
        if chi2_cdf(middle, degrees) < probability:
            low = middle
        else:
            high = middle
    return 0.5 * (low + high)
