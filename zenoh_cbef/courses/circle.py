"""A target that goes round."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import numpy as np

from zenoh_cbef.arrays import Floats
from zenoh_cbef.courses.base import CourseSettings, around


@dataclass(frozen=True)
class Circle:
    """A horizontal circle of `radius` around `position`, once in a `period`."""

    settings: CourseSettings

    @classmethod
    def of(cls, settings: CourseSettings) -> Self:
        """The course of these settings."""
        return cls(settings)

    def states(self, time: Floats) -> Floats:
        """Cosine and sine, (t, 6)."""
        rate = 2.0 * np.pi / self.settings.period
        sine, cosine = np.sin(rate * time), np.cos(rate * time)
        state = np.zeros((len(time), 6))
        state[:, 0], state[:, 1] = cosine, sine
        state[:, 3], state[:, 4] = -rate * sine, rate * cosine
        return around(self.settings.position, self.settings.radius, state)
