"""Receivers that repeat themselves."""

from __future__ import annotations

from typing import Literal

import numpy as np

from zenoh_cbef.arrays import Floats
from zenoh_cbef.faults.sensing import Readings, SensorFault


class SensorStuck(SensorFault):
    """Receivers go on giving the last range from before the fault (the first one in it, where there is none before).

    A beacon that is not heard still gives no range.
    """

    kind: Literal["sensor-stuck"]

    def measured(self, readings: Readings, index: int) -> Floats:  # noqa: ARG002 - nothing is drawn
        """One value for each agent."""
        heard = np.isfinite(readings.ranges)
        before = heard & (readings.time < self.since)
        steps = heard.shape[1]
        last = steps - 1 - before[:, ::-1].argmax(axis=1)
        first = (heard & readings.on).argmax(axis=1)
        kept = np.where(before.any(axis=1), last, first)[:, None]
        return np.where(heard, np.take_along_axis(readings.ranges, kept, axis=1), np.nan)

    @property
    def error(self) -> float:
        """No range that there is not without it."""
        return 0.0
