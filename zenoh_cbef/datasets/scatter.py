"""How much a recording's ranges scatter, from the ranges alone: where a filter that learns their noise may begin."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from zenoh_cbef.arrays import Floats
from zenoh_cbef.datasets.dataset import Dataset

NEAR = 3.0
"""Ranges further apart than this many usual intervals are no neighbours: the target turns between them."""

LEAST = 20
"""Of how many ranges at least a recording has to tell anything."""

_GROWTH = 1.25
_NORMAL = 0.6745
"""The median size of a standard normal number."""


def scatter(dataset: Dataset, apart: int = 1) -> float | None:
    """The standard deviation, m, of ranges about a line through those `apart` before and after; None for too few.

    With weights a and b = 1 - a of the two neighbours, what is left has 1 + a^2 + b^2 times the variance of a range.
    The median of its size is not moved by outliers, nor by anything that the ranges of an anchor have in common.
    What turns between these adds to it, and errors that last longer than that are left out.
    """
    longest = NEAR * apart * (dataset.interval or np.inf)
    found = []
    for anchor in range(len(dataset.anchors)):
        own = dataset.range_anchor == anchor
        time, ranges = dataset.range_time[own], dataset.ranges[own]
        before, middle, later = slice(None, -2 * apart), slice(apart, -apart), slice(2 * apart, None)
        span, step = time[later] - time[before], time[middle] - time[before]
        near = (span > 0.0) & (span <= 2.0 * longest)
        after = step[near] / span[near]
        left = ranges[middle][near] - (1.0 - after) * ranges[before][near] - after * ranges[later][near]
        found.append(np.abs(left) / np.sqrt(1.0 + after**2 + (1.0 - after) ** 2))
    sizes = np.concatenate(found)
    return deviation(sizes) if len(sizes) >= LEAST else None


def growing(first: int, most: int) -> Iterator[int]:
    """How many ranges apart others are looked at, a quarter more each time: until the motion shows beside the noise."""
    while first <= most:
        yield first
        first = max(first + 1, int(_GROWTH * first))


def deviation(values: Floats) -> float:
    """The standard deviation of normal numbers whose median size is that of these."""
    return float(np.median(np.abs(values))) / _NORMAL
