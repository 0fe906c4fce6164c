"""A target that stays where it is."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Self

import numpy as np

from zenoh_cbef.arrays import Floats
from zenoh_cbef.tracking.motion.base import LinearMotion, MotionSettings, along_axes
from zenoh_cbef.tracking.motion.jump import Jump
from zenoh_cbef.tracking.motion.ncv import NearlyConstantVelocity


@dataclass(frozen=True)
class Stationary(LinearMotion):
    """p(k+1) = p(k) + w_p(k), v(k+1) = w_v(k), with the noise of `Jump`: a target at rest, pushed at any moment.

    throughout: pushed all the step long, as in the nearly-constant-velocity model. Then a target that goes on seems to
    be twice as fast as it is, as each step begins at rest.
    """

    throughout: bool = False

    @classmethod
    def of(cls, settings: MotionSettings) -> Self:
        """The model of these settings."""
        return cls(settings.dt, settings.stepwise_std, settings.axes, settings.throughout)

    @cached_property
    def transition(self) -> Floats:
        """A, (s, s): no velocity is carried on."""
        return along_axes([[1.0, 0.0], [0.0, 0.0]], self.axes)

    @cached_property
    def process_noise(self) -> Floats:
        """Q, (s, s)."""
        like = NearlyConstantVelocity if self.throughout else Jump
        return np.asarray(like(self.dt, self.acceleration_std, self.axes).process_noise)
