"""Beacons that are not heard."""

from __future__ import annotations

from typing import Literal

import numpy as np

from zenoh_cbef.arrays import Floats
from zenoh_cbef.faults.sensing import Readings, SensorFault
from zenoh_cbef.quantities import Probability
from zenoh_cbef.streams import stream, uniform


class SensorDropout(SensorFault):
    """Each beacon goes unheard with `probability`."""

    kind: Literal["sensor-dropout"]
    probability: Probability = 1.0

    def measured(self, readings: Readings, index: int) -> Floats:
        """No range where a uniform draw falls below the probability."""
        key = stream(readings.seed, f"sensor-dropout/{index}", readings.agent)
        return np.where(uniform(key, readings.step) < self.probability, np.nan, readings.ranges)

    @property
    def error(self) -> float:
        """No range that there is not without it."""
        return 0.0
