"""Ranges that are off by a constant."""

from __future__ import annotations

from typing import Literal

from zenoh_cbef.arrays import Floats
from zenoh_cbef.faults.sensing import Readings, SensorFault
from zenoh_cbef.quantities import Metres


class SensorBias(SensorFault):
    """Ranges are longer by `bias` (m; shorter where it is negative)."""

    kind: Literal["sensor-bias"]
    bias: Metres

    def measured(self, readings: Readings, index: int) -> Floats:  # noqa: ARG002 - nothing is drawn
        """The same error at every step."""
        return readings.ranges + self.bias

    @property
    def error(self) -> float:
        """The bias."""
        return abs(self.bias)
