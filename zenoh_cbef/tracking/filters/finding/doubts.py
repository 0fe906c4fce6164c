"""What an agent remembers that supposes a receiver to be wrong, and what it says of its estimate meanwhile."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import numpy as np

from zenoh_cbef.arrays import Floats
from zenoh_cbef.tracking.copying import replace
from zenoh_cbef.tracking.filters.finding.squared_ranges import Seen
from zenoh_cbef.tracking.status import ACQUIRING, LOST, TRACKING, Status

SLOT = 9
"""Numbers that an agent tells: 1, its position (3), its range and the rate, and their covariance (3)."""


@dataclass(frozen=True)
class Doubts(Seen):
    """How far an agent is with supposing, arrays (n, ...), and what it saw in the last steps.

    step: the step. doing: 0, or the number of the step in which agents tell. vote: whether an agent of the network
    wishes that. rest: for how many steps it does not begin again. left: whether the agent leaves out its own ranges,
    and own: how badly they fit meanwhile. open: whether nothing that was supposed explained the ranges. agent: its
    number, -1 if it does not know it. said, seconds: its status, and for how long, s. slot: what it tells. table:
    what all told.
    """

    step: Floats
    doing: Floats
    vote: Floats
    rest: Floats
    left: Floats
    own: Floats
    open: Floats
    agent: Floats
    said: Floats
    seconds: Floats
    slot: Floats
    table: Floats

    @classmethod
    def first(cls, count: int, agents: int, kept: int) -> Self:
        """Of so many agents of networks of `agents` before the first step; kept: how many steps they remember."""
        none = np.zeros(count)
        return cls(
            *cls.nothing(count, kept),
            *(none, none, none, none, none, none, none, none - 1.0, none, none),
            np.zeros((count, SLOT)),
            np.zeros((count, agents, SLOT)),
        )

    @property
    def none(self) -> bool:
        """Whether no agent tells, wishes to, or lately did, and none is left out."""
        return not (self.doing + self.vote + self.rest + self.left + self.open).nonzero()[0].size

    def saying(self, status: Status) -> Self:
        """The same with what is said of the estimate."""
        return replace(self, said=status.which, seconds=status.seconds)

    def told(self, status: Status, dt: float) -> Status:
        """What an estimate is worth that is doubted.

        One that nothing explains is lost. A place just found does not prove itself while ranges do not fit it.
        """
        tracks, doubted = status.which == TRACKING, (self.vote > 0.0) | (self.doing > 0.0)
        new = doubted & (self.said == ACQUIRING)
        which = np.where(tracks & (self.open > 0.0), LOST, np.where(tracks & new, ACQUIRING, status.which))
        seconds = np.where(which == self.said, self.seconds + dt, 0.0)
        return replace(status, which=which, seconds=np.where(which == status.which, status.seconds, seconds))
