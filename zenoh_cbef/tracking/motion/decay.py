"""A target whose velocity decays where nothing drives it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from math import expm1
from typing import Self

import numpy as np

from zenoh_cbef.arrays import Floats
from zenoh_cbef.tracking.motion.base import LinearMotion, MotionSettings, along_axes

_SHORT = 1e-2
"""Below this share of the time constant a step's noise is computed by its series, as the closed form loses digits."""


@dataclass(frozen=True)
class DecayingVelocity(LinearMotion):
    """dp = v dt, dv = -v dt/T + s dB: the velocity is an Ornstein-Uhlenbeck process, with s^2 = q^2 D.

    Like a nearly constant velocity over times that are short beside T; over longer ones the velocity is forgotten, and
    what is not measured stays bounded: its spread is q sqrt(D T/2). time: T (s).
    """

    time: float = 10.0

    @classmethod
    def of(cls, settings: MotionSettings) -> Self:
        """The model of these settings."""
        return cls(settings.dt, settings.stepwise_std, settings.axes, settings.velocity_time)

    @cached_property
    def transition(self) -> Floats:
        """A, (s, s)."""
        way = -expm1(-self.dt / self.time)
        return along_axes([[1.0, self.time * way], [0.0, 1.0 - way]], self.axes)

    @cached_property
    def process_noise(self) -> Floats:
        """Q, (s, s): the exact integral over a step (Bar-Shalom, Li and Kirubarajan, 2001, section 8.2)."""
        step, power = self.dt / self.time, self.acceleration_std**2 * self.dt
        place, both, speed = _series(step) if step < _SHORT else _closed(step)
        time = self.time
        return power * along_axes([[time**3 * place, time**2 * both], [time**2 * both, time * speed]], self.axes)


def _closed(step: float) -> tuple[float, float, float]:
    way = -expm1(-step)
    return step - 2.0 * way + 0.5 * -expm1(-2.0 * step), 0.5 * way * way, 0.5 * -expm1(-2.0 * step)


def _series(step: float) -> tuple[float, float, float]:
    way = -expm1(-step)
    powers = step ** np.arange(3, 8)
    place = float(powers @ np.array([1 / 3, -1 / 4, 7 / 60, -1 / 24, 31 / 2520]))
    return place, 0.5 * way * way, 0.5 * -expm1(-2.0 * step)
