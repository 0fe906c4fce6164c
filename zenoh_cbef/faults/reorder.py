"""Messages out of order."""

from __future__ import annotations

from typing import Literal

from zenoh_cbef.faults.base import Effect, LinkFault, Messages, Probability
from zenoh_cbef.streams import stream, uniform


class Reorder(LinkFault):
    """Each message is overtaken by the next one of its link with `probability`; its round is over by then."""

    kind: Literal["reorder"]
    probability: Probability

    def effect(self, messages: Messages, index: int) -> Effect:
        """Overtaken where a uniform draw falls below the probability."""
        key = stream(messages.seed, f"reorder/{index}", messages.source, messages.destination)
        return Effect(overtaken=uniform(key, messages.step, messages.round) < self.probability)
