"""Independent (Bernoulli) loss of messages."""

from __future__ import annotations

from typing import Literal

from zenoh_cbef.faults.base import Effect, LinkFault, Messages, Probability
from zenoh_cbef.streams import stream, uniform


class Loss(LinkFault):
    """Each message is lost with `probability`, whatever became of the others."""

    kind: Literal["loss"]
    probability: Probability

    def effect(self, messages: Messages, index: int) -> Effect:
        """Lost where a uniform draw falls below the probability."""
        key = stream(messages.seed, f"loss/{index}", messages.source, messages.destination)
        return Effect(lost=uniform(key, messages.step, messages.round) < self.probability)
