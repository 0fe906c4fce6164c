"""Messages out of order."""

from __future__ import annotations

from typing import Literal

from zenoh_cbef.faults.base import Effect, LinkFault, Messages
from zenoh_cbef.quantities import Probability


class Reorder(LinkFault):
    """Each message is overtaken by the next one of its link with `probability`; its round is over by then."""

    kind: Literal["reorder"]
    probability: Probability

    def effect(self, messages: Messages, index: int) -> Effect:
        """Overtaken where a uniform draw falls below the probability."""
        return Effect(overtaken=messages.uniform(f"reorder/{index}") < self.probability)
