"""A target whose velocity may jump at any moment of a step."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from zenoh_cbef.arrays import Floats
from zenoh_cbef.tracking.motion.base import along_axes
from zenoh_cbef.tracking.motion.ncv import NearlyConstantVelocity


@dataclass(frozen=True)
class Jump(NearlyConstantVelocity):
    """x(k+1) = A x(k) + (D - t) u in position, u in velocity, u ~ N(0, q^2 D^2 I), at a moment t that is anywhere in D.

    A white acceleration has the same moments. The nearly-constant-velocity model has one acceleration for the whole
    step: from where the target got to it would conclude how fast it is now, which depends on when the jump was.
    """

    @cached_property
    def process_noise(self) -> Floats:
        """Q, (s, s): the mean over all moments."""
        dt = self.dt
        moments = along_axes([[dt**2 / 3.0, dt / 2.0], [dt / 2.0, 1.0]], self.axes)
        return np.asarray((self.acceleration_std * dt) ** 2 * moments)
