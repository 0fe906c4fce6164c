"""Independent (Bernoulli) loss of messages."""

from __future__ import annotations

from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from zenoh_cbef.faults.base import Fate, LinkFault, Messages
from zenoh_cbef.streams import stream, uniform


class Loss(LinkFault):
    """Each message is lost with `probability`, whatever became of the others."""

    kind: Literal["loss"]
    probability: Annotated[float, Field(ge=0.0, le=1.0, allow_inf_nan=False)]

    def fate(self, messages: Messages, index: int) -> Fate:
        """Lost where a uniform draw falls below the probability."""
        key = stream(messages.seed, f"loss/{index}", messages.source, messages.destination)
        lost = uniform(key, messages.step, messages.round) < self.probability
        return Fate(lost, np.zeros(lost.shape))
