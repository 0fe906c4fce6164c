"""How fast a recorded target changes its velocity, from the ranges alone."""

from __future__ import annotations

import numpy as np

from zenoh_cbef.datasets.dataset import Dataset
from zenoh_cbef.datasets.scatter import growing, scatter

_SHORT = 3
"""How many ranges apart those are about which ranges scatter by their noise more than by the motion."""

_TIMES, _MOST = 2.0, 128
"""Up to how many times the noise lines get longer, and the longest, in ranges."""


def agility(dataset: Dataset) -> float | None:
    """The acceleration q, m/s^2, that explains how ranges turn, if it lasts for one interval D; None for too few.

    It takes a target off the straight line through its places t before and after by q^2 D t^3/6, mean square. With the
    noise, of which lines through single ranges have 3/2 of the variance, ranges scatter about lines (see `scatter`) by

        m(t)^2 = sigma^2 + q^2 D t^3/9

    so two lengths tell both: a short one, and the first at which the motion adds as much as the noise, which is about
    as long as a filter remembers.
    """
    interval, short = dataset.interval, scatter(dataset, _SHORT)
    if interval is None or short is None:
        return None
    found = None
    for apart in growing(_SHORT + 1, _MOST):
        if (longer := scatter(dataset, apart)) is None:
            break
        power = 9.0 * max(longer**2 - short**2, 0.0) / (interval**3 * (apart**3 - _SHORT**3))
        found = float(np.sqrt(power / interval))
        if longer**2 > _TIMES * short**2:
            break
    return found
