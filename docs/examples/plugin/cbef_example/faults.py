"""Links that fade in and out."""

from __future__ import annotations

import numpy as np
from pydantic import BaseModel, Field

from zenoh_cbef.extending import Effect, LinkFault, Messages


class Depth(BaseModel):
    """The options of this fault. period: s, from one worst moment to the next. most: probability of a loss then."""

    period: float = Field(default=4.0, gt=0.0)
    most: float = Field(default=0.8, ge=0.0, le=1.0)


class Fading(LinkFault):
    """Messages are lost with a probability that comes and goes like a sine."""

    options: Depth = Depth()

    def effect(self, messages: Messages, index: int) -> Effect:
        """Lost where a uniform draw falls below the probability of the moment."""
        moment = messages.step * messages.dt / self.options.period
        probability = self.options.most * 0.5 * (1.0 - np.cos(2.0 * np.pi * moment))
        return Effect(lost=messages.uniform(f"fading/{index}") < probability)
