"""A filter with two fixed gains: the least that tracks."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Self

import numpy as np
from pydantic import BaseModel, Field

from zenoh_cbef.extending import (
    Abilities,
    Belief,
    Diagnostics,
    FilterSettings,
    Floats,
    Measurement,
    Motion,
    Sharing,
    Space,
    Update,
    own_range,
)


class Gains(BaseModel):
    """The options of this filter. alpha, beta: gains of position and velocity, without unit."""

    alpha: float = Field(default=0.5, gt=0.0, le=1.0)
    beta: float = Field(default=0.05, ge=0.0, le=1.0)


@dataclass(frozen=True)
class FixedGains:
    """Fixed gains along the direction to the agent, then consensus on the state."""

    motion: Motion
    space: Space
    gains: Gains

    abilities: ClassVar = Abilities(covariance=False)
    options: ClassVar = Gains

    @classmethod
    def sharing(cls, settings: FilterSettings) -> Sharing:
        """The state itself is exchanged."""
        return Sharing(settings.motion.size)

    @classmethod
    def of(cls, settings: FilterSettings) -> Self:
        """The filter of these settings."""
        return cls(settings.motion, settings.space, Gains.model_validate(settings.options))

    def update(self, belief: Belief, measurement: Measurement) -> Update:
        """The corrected state (n, s) is the payload."""
        state = self.motion.predict_state(belief.state)
        predicted, row = own_range(self.space, state, measurement.position, measurement.age)
        measured = np.isfinite(measurement.range)
        innovation = np.where(measured, measurement.range - predicted, 0.0)
        correction = innovation[:, None] * row[:, : self.space.axes]
        gains = self.gains.alpha * correction, self.gains.beta / self.motion.dt * correction
        said = Diagnostics.where(measured, innovation=np.abs(innovation), weight=np.ones(len(state)))
        return Update(state + np.concatenate(gains, axis=1), said)

    def conclude(self, payload: Floats, update: Update) -> Belief:
        """The state that consensus left; there is no covariance."""
        return Belief(payload, None)
