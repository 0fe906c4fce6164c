"""A target that goes in a figure of eight."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import numpy as np

from zenoh_cbef.arrays import Floats
from zenoh_cbef.courses.base import CourseSettings, around


@dataclass(frozen=True)
class Lemniscate:
    """A horizontal figure of eight (the lemniscate of Gerono) of `radius` around `position`, once in a `period`."""

    settings: CourseSettings

    @classmethod
    def of(cls, settings: CourseSettings) -> Self:
        """The course of these settings."""
        return cls(settings)

    def states(self, time: Floats) -> Floats:
        """Sine, and sine times cosine, (t, 6)."""
        rate = 2.0 * np.pi / self.settings.period
        sine, cosine = np.sin(rate * time), np.cos(rate * time)
        state = np.zeros((len(time), 6))
        state[:, 0], state[:, 1] = sine, sine * cosine
        state[:, 3], state[:, 4] = rate * cosine, rate * (cosine**2 - sine**2)
        return around(self.settings.position, self.settings.radius, state)
