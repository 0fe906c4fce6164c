"""Links of limited rate."""

from __future__ import annotations

from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from zenoh_cbef.faults.base import Effect, LinkFault, Messages
from zenoh_cbef.streams import uniform


class RateLimit(LinkFault):
    """A link carries `messages_per_second` at most, evenly; what exceeds the rate is dropped, nothing is queued.

    This is a token bucket that holds one token. Where in its interval the first token comes is drawn for each link.
    """

    kind: Literal["rate-limit"]
    messages_per_second: Annotated[float, Field(ge=0.0, le=1e9, allow_inf_nan=False)]

    def effect(self, messages: Messages, index: int) -> Effect:
        """Lost where no token has come since the message before."""
        key = messages.streams.key(f"rate-limit/{index}")
        tokens = self.messages_per_second * messages.spacing
        phase, number = uniform(key, 0), messages.number
        return Effect(lost=np.floor(phase + (number + 1) * tokens) == np.floor(phase + number * tokens))
