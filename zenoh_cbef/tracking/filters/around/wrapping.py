"""What filters that stand around another one have in common."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from zenoh_cbef.tracking.filters.base import Belief, Filter


@dataclass(frozen=True)
class Wrapping:
    """A filter around another one, which it resembles but for `more` numbers at the end of its payload.

    What the inner filter carries from step to step is its own belief, in `parts` of the outer one: an outer filter
    that changes a belief only on its way out changes nothing for the filter around it.
    """

    filter: Filter

    more: ClassVar[int] = 0

    def resumed(self, belief: Belief) -> Belief:
        """A belief that did not begin here, as this filter carries it from step to step."""
        return Belief(belief.state, belief.covariance, parts=(resumed(self.filter, belief),))


def resumed(chosen: Filter, belief: Belief) -> Belief:
    """A belief from elsewhere, as a filter needs it that is past its beginning."""
    return chosen.resumed(belief) if isinstance(chosen, Wrapping) else belief
