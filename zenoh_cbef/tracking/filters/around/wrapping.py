"""What filters that stand around another one have in common."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from zenoh_cbef.arrays import Bools
from zenoh_cbef.tracking.filters.base import Belief, Filter
from zenoh_cbef.tracking.filters.models.told_ranges import ToldRanges


@dataclass(frozen=True)
class Wrapping:
    """A filter around another one, with the inner filter's payload and `more` numbers at its end.

    `parts` of the outer belief has the inner filter's belief from step to step: if an outer filter changes a belief
    only when it returns it, the inner filter does not see that change.
    """

    filter: Filter

    more: ClassVar[int] = 0

    def resumed(self, belief: Belief) -> Belief:
        """A belief of another filter, in the form that this filter carries from step to step."""
        return Belief(belief.state, belief.covariance, parts=(resumed(self.filter, belief),))


def resumed(chosen: Filter, belief: Belief) -> Belief:
    """A belief of another filter, in the form that `chosen` needs after its first step."""
    return chosen.resumed(belief) if isinstance(chosen, Wrapping | ToldRanges) else belief


def inner_of(chosen: Filter) -> Filter:
    """The filter to which the parts of a belief of `chosen` belong; its own are of filters as it is one."""
    return chosen.filter if isinstance(chosen, Wrapping) else chosen


def denied(around: Filter, belief: Belief) -> Bools:
    """Of which agents (n,) the ranges that they tell each other deny the place."""
    while isinstance(around, Wrapping) and belief.parts:
        around, belief = around.filter, belief.parts[0]
    return around.denied(belief) if isinstance(around, ToldRanges) else np.zeros(len(belief.state), dtype=bool)
