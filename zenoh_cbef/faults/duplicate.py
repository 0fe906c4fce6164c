"""Messages that come twice."""

from __future__ import annotations

from typing import Literal

from zenoh_cbef.faults.base import Effect, LinkFault, Messages, Probability
from zenoh_cbef.streams import stream, uniform


class Duplicate(LinkFault):
    """Each message arrives a second time with `probability`; the receiver knows it by step and round."""

    kind: Literal["duplicate"]
    probability: Probability

    def effect(self, messages: Messages, index: int) -> Effect:
        """Duplicated where a uniform draw falls below the probability."""
        key = stream(messages.seed, f"duplicate/{index}", messages.source, messages.destination)
        return Effect(duplicated=uniform(key, messages.step, messages.round) < self.probability)
