"""How far an agent is with looking for its target again, and the ranges that it keeps for that."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import numpy as np

from zenoh_cbef.arrays import Bools, Floats
from zenoh_cbef.tracking.copying import replace
from zenoh_cbef.tracking.filters.settings import FilterSettings
from zenoh_cbef.tracking.ranging import Measurement


@dataclass(frozen=True)
class Search:
    """How far an agent is with looking for its target again, arrays (n, ...).

    step: the step. begun: that after which the fix began. doing: 0 the filter, otherwise a part of a fix. vote: whether
    the network wants a fix. adrift: above 0 where the agent has coasted too far to go on. place: its estimate without
    the ranges since then, prior: what a fix starts from, fix: the latest iteration; state and covariance each.
    correction: what that one changed. positions, ages, ranges: of the last steps.
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
    positions: Floats
    ages: Floats
    ranges: Floats

    @property
    def fixing(self) -> Bools:
        """Which agents are in a fix, (n,)."""
        return np.asarray(self.doing > 0.0)

    @property
    def idle(self) -> bool:
        """Whether no agent is in a fix, wants one, or is adrift."""
        return not (self.doing + self.vote + self.adrift).nonzero()[0].size

    def at(self, step: Floats, new: Measurement, dt: float) -> Self:
        """The same in the next step (n,), dt (s) later, with what was heard in it in place of the oldest."""
        shape = self.ages.shape
        positions, ages, ranges = np.empty((*shape, 3)), np.empty(shape), np.empty(shape)
        positions[:, :-1], positions[:, -1] = self.positions[:, 1:], new.position
        ages[:, :-1], ages[:, -1] = self.ages[:, 1:] + dt, new.age
        ranges[:, :-1], ranges[:, -1] = self.ranges[:, 1:], new.range
        return replace(self, step=step, positions=positions, ages=ages, ranges=ranges)


def decides(settings: FilterSettings, step: Floats) -> Bools:
    """In which steps (n,) agents tell their wishes; in the others the decision spreads."""
    cycle = settings.deciding or settings.reacquires
    place = step % cycle
    return np.asarray((place > 0.0) & (place <= cycle - settings.spreading))
