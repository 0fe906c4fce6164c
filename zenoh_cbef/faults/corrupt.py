"""Damaged messages."""

from __future__ import annotations

from typing import Literal

from zenoh_cbef.faults.base import Effect, LinkFault, Messages
from zenoh_cbef.quantities import Probability


class Corrupt(LinkFault):
    """Each message arrives with flipped bytes with `probability`; the receiver rejects it."""

    kind: Literal["corrupt"]
    probability: Probability

    def effect(self, messages: Messages, index: int) -> Effect:
        """Corrupted where a uniform draw falls below the probability."""
        return Effect(corrupted=messages.uniform(f"corrupt/{index}") < self.probability)
