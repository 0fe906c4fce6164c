"""How far an agent is with looking for its target again, and the ranges that it keeps for that."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from zenoh_cbef.arrays import Bools, Floats
from zenoh_cbef.tracking.filters.finding.squared_ranges import Seen
from zenoh_cbef.tracking.filters.settings import FilterSettings


@dataclass(frozen=True)
class Search(Seen):
    """How far an agent is with looking for its target again, arrays (n, ...), and what it saw in the last steps.

    step: the step. begun: that after which the fix began. doing: 0 the filter, otherwise a part of a fix. vote: whether
    the network wants a fix. adrift: above 0 where the agent has coasted too far to go on. place: its estimate without
    the ranges since then, prior: what a fix starts from, fix: the latest iteration; state and covariance each.
    correction: what that one changed.
    """

    step: Floats
    begun: Floats
    doing: Floats
    vote: Floats
    adrift: Floats
    place: Floats
    place_covariance: Floats
    prior: Floats
    prior_covariance: Floats
    fix: Floats
    fix_covariance: Floats
    correction: Floats

    @property
    def fixing(self) -> Bools:
        """Which agents are in a fix, (n,)."""
        return np.asarray(self.doing > 0.0)

    @property
    def idle(self) -> bool:
        """Whether no agent is in a fix, wants one, or is adrift."""
        return not (self.doing + self.vote + self.adrift).nonzero()[0].size


def decides(settings: FilterSettings, step: Floats) -> Bools:
    """In which steps (n,) agents tell their wishes; in the others the decision spreads."""
    cycle = settings.deciding or settings.reacquires
    place = step % cycle
    return np.asarray((place > 0.0) & (place <= cycle - settings.spreading))
