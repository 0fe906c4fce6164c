"""How far a network may coast: as long as ranges are straight lines over what its estimate leaves open."""

from __future__ import annotations

import numpy as np

from zenoh_cbef.arrays import Bools, Floats
from zenoh_cbef.tracking.filters.base import Belief
from zenoh_cbef.tracking.filters.finding.squared_ranges import Seen
from zenoh_cbef.tracking.filters.settings import FilterSettings
from zenoh_cbef.tracking.linalg import leading_trace
from zenoh_cbef.tracking.ranging import Space, own_range
from zenoh_cbef.tracking.status import Status


def drifted(settings: FilterSettings, belief: Belief, status: Status, seen: Seen) -> Bools:
    """Which agents have coasted too far to linearise at their estimate, (n,). seen: their latest ranges.

    Those whose claimed error is twenty times the usual one, or over whose claimed error ranges bend. No agents that
    all go by hypotheses which follow the bend of ranges: a fix would forget them. Nor agents that have had ranges all
    the while: where a network notices that its target moves otherwise it claims more, and these tell where it is.
    """
    coasts, astray = status.coasts, status.adrift
    if not settings.drifts:
        return np.zeros_like(coasts)
    if settings.bends and np.count_nonzero(coasts):
        place = belief.state, belief.known_covariance, seen.positions[:, -1]
        astray = astray | coasts & bent(settings.space, *place, settings.range_std)
    if not settings.silence or not np.count_nonzero(astray):
        return astray
    return astray & ~np.isfinite(seen.ranges[:, -settings.silence :]).any(axis=1)


def bent(space: Space, state: Floats, covariance: Floats, position: Floats, range_std: float) -> Bools:
    """Whether a range bends by more than its noise over what an estimate leaves open, (n,).

        tr(G P)/2 > sigma,   G = (I - u u^T)/d: the second derivative of the range d in direction u

    state (n, s), covariance (n, s, s): of the estimate. position: of the agents, (n, 3), m. range_std: sigma, m.
    """
    axes = space.axes
    distance, row = own_range(space, state, position, np.zeros(len(state)))
    known, along = covariance[:, :axes, :axes], row[:, :axes]
    across = leading_trace(known, axes) - np.add.reduce(along * np.add.reduce(known * along[:, None], axis=2), axis=1)
    return np.asarray(across > 2.0 * range_std * distance)
