"""Ranges that are off by a constant."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from zenoh_cbef.faults.base import Floats
from zenoh_cbef.faults.sensing import Readings, SensorFault


class SensorBias(SensorFault):
    """Ranges are longer by `bias` (m; shorter where it is negative)."""

    kind: Literal["sensor-bias"]
    bias: Annotated[float, Field(allow_inf_nan=False)]

    def measured(self, readings: Readings, index: int) -> Floats:  # noqa: ARG002 - nothing is drawn
        """The same error at every step."""
        return readings.ranges + self.bias
