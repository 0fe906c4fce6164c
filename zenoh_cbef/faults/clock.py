"""Clocks that are wrong."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from zenoh_cbef.arrays import Floats
from zenoh_cbef.faults.base import Fault
from zenoh_cbef.faults.sensing import Readings, SensorFault

Offset = Annotated[float, Field(ge=-1e6, le=1e6, allow_inf_nan=False)]
Drift = Annotated[float, Field(ge=-1.0, le=1.0, allow_inf_nan=False)]


class Clock(SensorFault):
    """Agents' clocks are ahead by `offset` (s), and gain `drift` seconds per second while the fault is on.

    A range is the time of flight by the agent's clock: a clock that is 1 ns ahead makes it 0.3 m longer. An agent
    process also stamps its messages with it.
    """

    kind: Literal["clock"]
    offset: Offset = 0.0
    drift: Drift = 0.0

    def ahead(self, time: Floats) -> Floats:
        """By how much the clocks are ahead at run times (s), s."""
        return self.offset + self.drift * (time - self.since)

    def measured(self, readings: Readings, index: int) -> Floats:  # noqa: ARG002 - nothing is drawn
        """Ranges from arrival times by a wrong clock."""
        return readings.ranges + readings.signal_speed * self.ahead(readings.time)


def clocks_of(faults: Sequence[Fault], agent: int) -> list[Clock]:
    """The faults of one agent's clock."""
    return [fault for fault in faults if isinstance(fault, Clock) and fault.selects(np.array([agent])).all()]


def ahead(clocks: Sequence[Clock], time: float) -> float:
    """By how much a clock with these faults is ahead at a run time (s), s."""
    return sum(float(fault.ahead(np.array(time))) for fault in clocks if fault.active(time))
