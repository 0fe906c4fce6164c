"""A target that stays where it is."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from zenoh_cbef.arrays import Floats
from zenoh_cbef.tracking.motion.base import LinearMotion, along_axes


@dataclass(frozen=True)
class Stationary(LinearMotion):
    """p(k+1) = p(k) + D^2 w(k)/2, v(k+1) = D w(k), w ~ N(0, q^2 I): each step begins at rest, and q may push it."""

    @cached_property
    def transition(self) -> Floats:
        """A, (s, s): no velocity is carried on."""
        return along_axes([[1.0, 0.0], [0.0, 0.0]], self.axes)

    @cached_property
    def process_noise(self) -> Floats:
        """Q, (s, s), that of the nearly-constant-velocity model."""
        gain = np.kron(np.array([[0.5 * self.dt**2], [self.dt]]), np.eye(self.axes))
        return np.asarray(self.acceleration_std**2 * gain @ gain.T)
