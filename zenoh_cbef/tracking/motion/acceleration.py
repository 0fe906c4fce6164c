"""A target whose acceleration is nearly constant."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Self

import numpy as np

from zenoh_cbef.arrays import Floats
from zenoh_cbef.tracking.motion.base import LinearMotion, MotionSettings, along_axes


@dataclass(frozen=True)
class NearlyConstantAcceleration(LinearMotion):
    """State (p, v, a), da = q dB: the acceleration changes by q in a second (Bar-Shalom et al., 2001, section 6.2)."""

    @classmethod
    def of(cls, settings: MotionSettings) -> Self:
        """The model of these settings."""
        return cls(settings.dt, settings.acceleration_std, settings.axes)

    @cached_property
    def size(self) -> int:
        """Position, velocity and acceleration."""
        return 3 * self.axes

    @property
    def extra_covariance(self) -> Floats:
        """Before the first step the acceleration is unknown up to q."""
        return np.asarray(np.square(self.acceleration_std) * np.eye(self.axes))

    @cached_property
    def transition(self) -> Floats:
        """A, (s, s)."""
        dt = self.dt
        return along_axes([[1.0, dt, 0.5 * dt**2], [0.0, 1.0, dt], [0.0, 0.0, 1.0]], self.axes)

    @cached_property
    def process_noise(self) -> Floats:
        """Q, (s, s): the exact integral over a step."""
        dt = self.dt
        noise = [
            [dt**5 / 20.0, dt**4 / 8.0, dt**3 / 6.0],
            [dt**4 / 8.0, dt**3 / 3.0, dt**2 / 2.0],
            [dt**3 / 6.0, dt**2 / 2.0, dt],
        ]
        return np.asarray(self.acceleration_std**2 * along_axes(noise, self.axes))
