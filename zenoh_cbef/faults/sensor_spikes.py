"""Ranges that are wildly wrong now and then."""

from __future__ import annotations

from typing import Literal

import numpy as np

from zenoh_cbef.arrays import Floats
from zenoh_cbef.faults.sensing import Readings, SensorFault
from zenoh_cbef.quantities import Length, Probability
from zenoh_cbef.streams import normal, stream, uniform


class SensorSpikes(SensorFault):
    """Each range gets, with `probability`, a further normal error of standard deviation `std` (m)."""

    kind: Literal["sensor-spikes"]
    probability: Probability
    std: Length = 5.0

    def measured(self, readings: Readings, index: int) -> Floats:
        """Spikes of either sign."""
        key, size = (
            stream(readings.seed, name, readings.agent)
            for name in (f"sensor-spikes/{index}", f"sensor-spikes/{index}/size")
        )
        hit = uniform(key, readings.step) < self.probability
        return readings.ranges + np.where(hit, self.std * normal(size, readings.step), 0.0)

    @property
    def error(self) -> float:
        """Ten standard deviations."""
        return 10.0 * self.std
