"""What ranges count for, as some of them may be wrong: they saturate, or told outliers decide."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from zenoh_cbef.arrays import Bools, Floats
from zenoh_cbef.tracking.outliers import Errors


@dataclass(frozen=True)
class Weighed:
    """What ranges count for, (n,): weight, of 1; precision, 1/m^2, 0 where there is none; and what outliers add, 1/m.

    more: the part of the information vector along the row that does not follow from the precision; None: none does.
    cost: of told outliers, see `Informed`.
    """

    weight: Floats
    precision: Floats
    more: Floats | None = None
    cost: Floats | None = None

    def along(self, equivalent: Floats) -> Floats:
        """The information vector along the row, (n,); equivalent: what linear ranges would have been, m."""
        plain = self.precision * equivalent
        return plain if self.more is None else plain + self.more


def weigh(
    innovation: Floats,
    spread: Floats,
    variance: Floats,
    measured: Bools,
    informs: Floats,
    *,
    xi: float,
    power: int,
    widens: float,
    outliers: Errors | None,
) -> Weighed:
    """What ranges count for, (n,), whose innovations (m) were predicted to have a standard deviation `spread` (m).

    variance: of their noise, m^2. measured: where there is one. informs: the variance that information is divided by,
    m^2. xi, power: see `saturation`. widens: see `saturated_precision`. outliers: in place of all three.
    """
    if outliers is None:
        weight = saturation(innovation, xi * spread, power)
        there = np.where(measured, weight, 0.0)
        return Weighed(weight, saturated_precision(there, informs, spread, widens=widens))
    found = outliers.informed(innovation, spread, variance)
    once = measured * variance / informs
    precision = once * found.precision
    return Weighed(found.weight(variance), precision, once * found.pull - precision * innovation, found.cost)


def saturated_precision(weight: Floats, variance: Floats, spread: Floats, *, widens: float) -> Floats:
    """What a saturated range of this noise tells, 1/m^2, (...); weight: 0 where there is none.

        1/(sigma^2 + S^a sigma^(2 - 2a) (1/w - 1)),  S = H P H^T + sigma^2,  a = widens

    With a = 0, w/sigma^2, a range's pull is bounded at a prior that is as sure as the range. Where the prior is wide,
    H P H^T far above sigma^2, even w/sigma^2 outweighs it, and the estimate follows an outlier nearly all the way. With
    a = 1 the whole innovation has the variance S/w, so a range pulls w times as far as it would, with any prior; then
    the estimate does not follow a target that turned, either. spread: the root of S, m.
    """
    if not widens:
        return weight / variance
    there, above = weight > 0.0, weight.copy()
    above[~there] = 1.0
    unit = spread**2 if widens == 1.0 else spread ** (2.0 * widens) * variance ** (1.0 - widens)
    return there / (variance + unit * (1.0 / above - 1.0))


def saturation(innovation: Floats, level: Floats, power: int = 1) -> Floats:
    """Gain min(1, level/|innovation|)^power of the saturated innovation.

    Times the innovation it is Huber's function for power 1, which bounds it, and falls off again for power 2.
    """
    size = np.abs(innovation)
    inside = size <= level
    if np.logical_and.reduce(inside, axis=None):
        return inside.astype(np.float64)
    gain = np.where(inside, 1.0, level / np.where(size > 0.0, size, 1.0))
    return gain if power == 1 else gain**power
