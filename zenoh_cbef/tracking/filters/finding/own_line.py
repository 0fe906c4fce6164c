"""What an agent's ranges of the last steps say of its range now, and of how fast that changes: a robust line."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from zenoh_cbef.arrays import Bools, Floats
from zenoh_cbef.tracking.filters.finding.remembered_ranges import Wandering
from zenoh_cbef.tracking.filters.finding.squared_ranges import Seen
from zenoh_cbef.tracking.filters.weighing import saturation
from zenoh_cbef.tracking.linalg import inverse, matvec

_LEVEL = 3.0
"""At how many standard deviations off the line a range saturates."""

_GOOD = 0.75
"""The mean weight of ranges that are on a line."""

FASTEST = 100.0
"""Prior standard deviation of the range's rate, m/s: no information."""


@dataclass(frozen=True)
class OwnLine:
    """A line through an agent's ranges of the last steps, each robust against single ranges that are wrong.

        r(t) = r - r' t + e,   t: a range's age
        cov(e) = diag(sigma^2/w) + the target's wandering + (c t^2/2)(c t'^2/2),   c = |v|^2/r
        w = min(1, 3 s/|e|)^2,   of e off the line of medians (Theil, 1950)

    c is how ranges bend from a target that goes straight past an agent. A constant error stays in r, and leaves r' as
    it is.

    noise: sigma, m. wandering: of the target off a straight line. far: prior standard deviation of r, m.
    """

    noise: float
    wandering: Wandering
    far: float

    def fitted(self, seen: Seen, speed: Floats) -> tuple[Floats, Floats, Bools]:
        """Range and rate (n, 2), m and m/s, their covariance (n, 2, 2), and whether most ranges are on the line, (n,).

        speed: (n,), of the target, m/s.
        """
        measured = np.isfinite(seen.ranges)
        ranges, ages = np.where(measured, seen.ranges, 0.0), seen.ages
        place, rate = _line_of_medians(ranges, ages, measured)
        bend = 0.5 * (speed**2 / np.maximum(np.abs(place), 10.0 * self.noise))[:, None] * ages**2
        drift = self.wandering.covariance(ages[:, :, None], ages[:, None]) + bend[:, :, None] * bend[:, None]
        steps = range(ages.shape[1])
        off = np.where(measured, ranges - (place[:, None] - rate[:, None] * ages), 0.0)
        weight = saturation(off, _LEVEL * np.sqrt(self.noise**2 + drift[:, steps, steps]), 2)
        drift = np.where(measured[:, :, None] & measured[:, None], drift, 0.0)
        drift[:, steps, steps] += np.where(measured, self.noise**2 / weight, 1.0)
        rows = np.where(measured[:, :, None], np.stack([np.ones_like(ages), -ages], axis=2), 0.0)
        gain = rows.swapaxes(1, 2) @ inverse(drift)
        covariance = inverse(gain @ rows + np.diag([self.far**-2, FASTEST**-2]))
        good = np.add.reduce(np.where(measured, weight, 0.0), axis=1)
        many = np.add.reduce(measured, axis=1)
        return matvec(covariance, matvec(gain, ranges)), covariance, (many > 0) & (good >= _GOOD * many)


def _line_of_medians(ranges: Floats, ages: Floats, measured: Bools) -> tuple[Floats, Floats]:
    """Range now and its rate, (n,) each: the median of the slopes of all pairs, and of what that leaves."""
    first, second = np.triu_indices(ages.shape[1], 1)
    apart = ages[:, first] - ages[:, second]
    pairs = measured[:, first] & measured[:, second] & (apart != 0.0)
    rate = _median((ranges[:, second] - ranges[:, first]) / np.where(pairs, apart, 1.0), pairs)
    return _median(ranges + rate[:, None] * ages, measured), rate


def _median(values: Floats, counts: Bools) -> Floats:
    """Of those of the values (n, k) that count, (n,); 0 where none does."""
    order, many = np.sort(np.where(counts, values, np.inf), axis=1), counts.sum(axis=1)
    pair = np.take_along_axis(order, np.stack([(many - 1) // 2, many // 2], axis=1), axis=1)
    return np.where(many > 0, 0.5 * (pair[:, 0] + pair[:, 1]), 0.0)
