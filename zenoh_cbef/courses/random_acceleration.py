"""A target that accelerates at random."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from zenoh_cbef.arrays import Floats
from zenoh_cbef.courses.base import Settled
from zenoh_cbef.streams import normal, stream


@dataclass(frozen=True)
class RandomAcceleration(Settled):
    """Nearly constant velocity: from `position`, with `velocity`, and a new random acceleration in each step."""

    def states(self, time: Floats) -> Floats:
        """Sums of accelerations and velocities, (t, 6)."""
        target, steps, dt = self.settings, len(time) - 1, self.settings.dt
        key = stream(target.seed, "acceleration", np.arange(3))
        acceleration = target.acceleration_std * normal(key, np.arange(steps)[:, None])
        state = np.empty((steps + 1, 6))
        state[0] = [*target.position, *target.velocity]
        state[1:, 3:] = dt * acceleration
        state[:, 3:] = np.cumsum(state[:, 3:], axis=0)
        state[1:, :3] = dt * state[:-1, 3:] + 0.5 * dt**2 * acceleration
        state[:, :3] = np.cumsum(state[:, :3], axis=0)
        return state
