"""Independent (Bernoulli) loss of messages."""

from __future__ import annotations

from typing import Literal

from zenoh_cbef.faults.base import Effect, LinkFault, Messages
from zenoh_cbef.quantities import Probability


class Loss(LinkFault):
    """Each message is lost with `probability`, whatever became of the others."""

    kind: Literal["loss"]
    probability: Probability

    @property
    def loses_all(self) -> bool:
        """Whether no message gets through while it is on."""
        return self.probability == 1.0

    def effect(self, messages: Messages, index: int) -> Effect:
        """Lost where a uniform draw falls below the probability."""
        return Effect(lost=messages.uniform(f"loss/{index}") < self.probability)
