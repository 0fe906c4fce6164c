"""The nearly-constant-velocity model of the target."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from zenoh_cbef.arrays import Floats
from zenoh_cbef.tracking.motion.base import LinearMotion, along_axes


@dataclass(frozen=True)
class NearlyConstantVelocity(LinearMotion):
    """x(k+1) = A x(k) + B w(k), w ~ N(0, q^2 I), as in Ghods and Doostmohammadian (ICRoM 2024), eq. 1 to 3."""

    @cached_property
    def transition(self) -> Floats:
        """A, (s, s)."""
        return along_axes([[1.0, self.dt], [0.0, 1.0]], self.axes)

    @cached_property
    def process_noise(self) -> Floats:
        """Q = q^2 B B^T, (s, s)."""
        gain = np.kron(np.array([[0.5 * self.dt**2], [self.dt]]), np.eye(self.axes))
        return np.asarray(self.acceleration_std**2 * gain @ gain.T)
