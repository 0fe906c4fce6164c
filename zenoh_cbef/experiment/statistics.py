"""The median of a few runs, and its confidence interval."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from math import lgamma

import numpy as np

from zenoh_cbef.arrays import Floats

LEVEL = 0.95


@dataclass(frozen=True)
class Interval:
    """The median of so many runs, and the bounds of its 95 % interval; p90: 90 % of the runs are at or below it."""

    median: float
    low: float
    high: float
    runs: int
    p90: float


def median_interval(values: Sequence[float]) -> Interval:
    """Median, and the bounds of its 95 % bootstrap interval (percentiles), of one or more finite values.

    The interval is the exact one (Efron, The Jackknife, the Bootstrap and Other Resampling Plans, 1982, sec. 10.3):
    the limit of infinitely many resamples, computed without random numbers. For an even number the median lies
    between two order statistics; the interval reaches from the lower bound of the one to the upper of the other.
    """
    ordered = np.sort(np.asarray(values, dtype=np.float64))
    low, high = _ranks(len(ordered))
    p90 = float(np.quantile(ordered, 0.9, method="higher"))
    return Interval(float(np.median(ordered)), float(ordered[low]), float(ordered[high]), len(ordered), p90)


@cache
def _ranks(count: int) -> tuple[int, int]:
    """Which order statistics, from 0, bound the interval."""
    lower, upper = (count - 1) // 2, count // 2
    tail = (1.0 - LEVEL) / 2.0
    return _quantile(count, lower, tail), _quantile(count, upper, 1.0 - tail)


def _quantile(count: int, order: int, share: float) -> int:
    """Find the least rank j at which a resample's order statistic is at most x_j with at least this probability."""
    least, most = 0, count - 1
    while least < most:
        middle = (least + most) // 2
        if _at_most(count, order, middle) >= share:
            most = middle
        else:
            least = middle + 1
    return least


def _at_most(count: int, order: int, rank: int) -> float:
    """Compute P(at least order + 1 of count draws are among the rank + 1 smallest values)."""
    if rank + 1 >= count:
        return 1.0
    share = (rank + 1) / count
    drawn: Floats = np.arange(order + 1, count + 1, dtype=np.float64)
    choose = lgamma(count + 1) - np.array([lgamma(k + 1) + lgamma(count - k + 1) for k in drawn.tolist()])
    return float(np.exp(choose + drawn * np.log(share) + (count - drawn) * np.log1p(-share)).sum())
