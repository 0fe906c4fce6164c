"""How many ranges prove the place that another fix has found: those that fit it."""

from __future__ import annotations

import numpy as np

from zenoh_cbef.arrays import Floats
from zenoh_cbef.tracking.filters.finding.first_fix import FirstFix
from zenoh_cbef.tracking.filters.finding.remembered_ranges import Remembered
from zenoh_cbef.tracking.filters.finding.squared_ranges import Seen
from zenoh_cbef.tracking.status import CUT


def fitting(fix: FirstFix, state: Floats, seen: Seen) -> Floats:
    """How many of each agent's ranges fit a fix, (n,): those with z^2 < 9 (sigma^2 + q^2 D t^3/3) of age t.

    state: the fix, (n, s). seen: the ranges that it is made of, without what is known of their biases.
    """
    ranges = Remembered.at(fix.space, state, seen)
    variance = fix.range_std**2 + fix.wandering.covariance(ranges.ages, ranges.ages)
    fits = ranges.measured & (ranges.innovation**2 < CUT * variance)
    return np.asarray(fits.sum(axis=1), dtype=np.float64)
