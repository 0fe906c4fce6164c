"""Agents that send wrong values."""

from __future__ import annotations

from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from zenoh_cbef.arrays import Floats
from zenoh_cbef.faults.outgoing import SenderFault, Sent
from zenoh_cbef.quantities import Metres
from zenoh_cbef.streams import normal, stream


class Byzantine(SenderFault):
    """Agents that send all their neighbours the same wrong values, and go on tracking honestly for themselves.

    mode: constant - the target is `magnitude` metres farther along every axis; drift - so many metres more for every
    second since `from`; random - displaced by normal draws of that standard deviation along every axis, new in every
    message; scale - every number times `magnitude`; replay - the messages of `steps` steps ago. LeBlanc et al. call
    a sender malicious that sends the same wrong values to all its neighbours.
    """

    kind: Literal["byzantine"]
    mode: Literal["constant", "random", "drift", "scale", "replay"] = "constant"
    magnitude: Metres = 5.0
    steps: Annotated[int, Field(ge=1, le=10_000)] = 10

    @property
    def memory(self) -> int:
        """Only a replay looks back."""
        return self.steps if self.mode == "replay" else 0

    def sent(self, honest: Sent, index: int) -> Floats:
        """The wrong values."""
        if self.mode == "replay":
            return honest.past
        if self.mode == "scale":
            return self.magnitude * honest.message
        return honest.displaced(honest.message, self._offset(honest, index))

    def _offset(self, honest: Sent, index: int) -> Floats:
        """By how much the target is displaced, (n, 3), m."""
        size = np.full((len(honest.agent), 3), self.magnitude)
        if self.mode == "drift":
            return size * honest.elapsed
        if self.mode == "random":
            key = stream(honest.seed, f"byzantine/{index}", honest.agent, honest.round)[:, None]
            return size * normal(key, honest.step, np.arange(3))
        return size
