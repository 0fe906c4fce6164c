"""A target that climbs in circles."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Self

import numpy as np
from pydantic import BaseModel, Field

from zenoh_cbef.extending import CourseSettings, Floats


class Climb(BaseModel):
    """The options of this motion. rate: how fast the target climbs, m/s."""

    rate: float = Field(default=0.2, ge=-100.0, le=100.0)


@dataclass(frozen=True)
class Helix:
    """A circle of `target.radius` around `target.position`, once in a `target.period`, that climbs."""

    settings: CourseSettings
    climb: Climb

    options: ClassVar = Climb

    @classmethod
    def of(cls, settings: CourseSettings) -> Self:
        """The motion of these settings."""
        return cls(settings, Climb.model_validate(settings.options))

    def states(self, time: Floats) -> Floats:
        """Positions and velocities (t, 6) at run times (t,)."""
        radius, rate = self.settings.radius, 2.0 * np.pi / self.settings.period
        cosine, sine = np.cos(rate * time), np.sin(rate * time)
        position = np.stack([radius * cosine, radius * sine, self.climb.rate * time], axis=1)
        velocity = [-radius * rate * sine, radius * rate * cosine, np.full(len(time), self.climb.rate)]
        return np.concatenate([position + self.settings.position, np.stack(velocity, axis=1)], axis=1)
