"""Damaged messages."""

from __future__ import annotations

from typing import Literal

from zenoh_cbef.faults.base import Effect, LinkFault, Messages, Probability
from zenoh_cbef.streams import stream, uniform


class Corrupt(LinkFault):
    """Each message arrives with flipped bytes with `probability`; the receiver rejects it."""

    kind: Literal["corrupt"]
    probability: Probability

    def effect(self, messages: Messages, index: int) -> Effect:
        """Corrupted where a uniform draw falls below the probability."""
        key = stream(messages.seed, f"corrupt/{index}", messages.source, messages.destination)
        return Effect(corrupted=uniform(key, messages.step, messages.round) < self.probability)
