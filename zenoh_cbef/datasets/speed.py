"""How fast a recorded target is along an axis, from the ranges alone."""

from __future__ import annotations

import numpy as np

from zenoh_cbef.arrays import Floats
from zenoh_cbef.datasets.dataset import Dataset
from zenoh_cbef.datasets.scatter import LEAST, NEAR, deviation, growing, scatter

_TIMES, _MOST = 4.0, 512
"""How many times what noise explains ranges have to change by, and over how many of them at most."""

_FAR = 9.0
"""The square of how many usual sizes a rate is at most: a range that is wrong for long jumps at its begin and end."""


def speed(dataset: Dataset, most_noise: float = np.inf) -> float | None:
    """The standard deviation, m/s, of the target's velocity along an axis; None for too few ranges, or none that shows.

    That is how fast ranges change, as a target's directions have nothing to do with those to the agents. Between two
    ranges that are a span t apart noise changes them, too, by 2 sigma^2 mean square. A short span hides no turn, so the
    first is taken at which the change is well above that. most_noise: what sigma is at most, m: where ranges are rare,
    they scatter by the motion.
    """
    interval, noise = dataset.interval, scatter(dataset)
    if interval is None or noise is None:
        return None
    noise = min(noise, most_noise)
    for apart in growing(1, _MOST):
        rates, spans = _rates(dataset, apart, NEAR * apart * interval)
        if len(rates) < LEAST:
            break
        square = float(np.mean(np.minimum(rates**2, _FAR * deviation(rates) ** 2)))
        by_noise = 2.0 * noise**2 * float(np.mean(spans**-2))
        if square > _TIMES * by_noise:
            return float(np.sqrt(square))
    return None


def _rates(dataset: Dataset, apart: int, longest: float) -> tuple[Floats, Floats]:
    """How fast ranges of one agent that are so many apart change, m/s, and what time is between them, s."""
    changes, spans = [np.zeros(0)], [np.zeros(0)]
    for anchor in range(len(dataset.anchors)):
        own = dataset.range_anchor == anchor
        time, ranges = dataset.range_time[own], dataset.ranges[own]
        span = time[apart:] - time[:-apart]
        near = (span > 0.0) & (span <= longest)
        changes.append((ranges[apart:] - ranges[:-apart])[near])
        spans.append(span[near])
    every = np.concatenate(spans)
    return np.concatenate(changes) / every, every
