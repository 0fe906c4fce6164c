"""Late messages."""

from __future__ import annotations

from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from zenoh_cbef.faults.base import Fate, LinkFault, Messages
from zenoh_cbef.streams import stream, uniform

Milliseconds = Annotated[float, Field(ge=0.0, allow_inf_nan=False)]


class Delay(LinkFault):
    """Each message takes `milliseconds`, plus a uniform share of `jitter_ms`, longer to arrive."""

    kind: Literal["delay"]
    milliseconds: Milliseconds
    jitter_ms: Milliseconds = 0.0

    def fate(self, messages: Messages, index: int) -> Fate:
        """Never lost; delayed by a constant and a uniform part."""
        key = stream(messages.seed, f"delay/{index}", messages.source, messages.destination)
        delay = self.milliseconds + self.jitter_ms * uniform(key, messages.step, messages.round)
        return Fate(np.zeros(delay.shape, dtype=bool), 1e-3 * delay)
