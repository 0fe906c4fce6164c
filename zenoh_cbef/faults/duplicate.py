"""Messages that come twice."""

from __future__ import annotations

from typing import Literal

from zenoh_cbef.faults.base import Effect, LinkFault, Messages
from zenoh_cbef.quantities import Probability


class Duplicate(LinkFault):
    """Each message arrives a second time with `probability`; the receiver knows it by step and round."""

    kind: Literal["duplicate"]
    probability: Probability

    def effect(self, messages: Messages, index: int) -> Effect:
        """Duplicated where a uniform draw falls below the probability."""
        return Effect(duplicated=messages.uniform(f"duplicate/{index}") < self.probability)
