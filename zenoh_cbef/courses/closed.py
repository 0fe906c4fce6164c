"""What ways have in common that lead back to their beginning."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass

import numpy as np

from zenoh_cbef.arrays import Floats
from zenoh_cbef.courses.base import Settled


@dataclass(frozen=True)
class Closed(Settled, ABC):
    """A horizontal way of `radius` around `position`, once in a `period`."""

    def states(self, time: Floats) -> Floats:
        """Cosine and sine of the angle, (t, 6)."""
        rate = 2.0 * np.pi / self.settings.period
        state = np.zeros((len(time), 6))
        state[:, :2], state[:, 3:5] = self.unit(np.cos(rate * time), np.sin(rate * time), rate)
        state *= self.settings.radius
        state[:, :3] += np.array(self.settings.position)
        return state

    @staticmethod
    @abstractmethod
    def unit(cosine: Floats, sine: Floats, rate: float) -> tuple[Floats, Floats]:
        """Positions and velocities, both (t, 2), on the way of size one around the origin.

        cosine, sine: of the angles, (t,). rate: of the angle, 1/s.
        """
