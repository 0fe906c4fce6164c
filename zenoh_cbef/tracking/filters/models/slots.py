"""What agents put into payloads that tell each other their ranges, each at its own place, and read from averages."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from zenoh_cbef.arrays import Bools, Floats
from zenoh_cbef.tracking.copying import replace
from zenoh_cbef.tracking.filters.information_form import variance_of
from zenoh_cbef.tracking.filters.models.branching import Heard
from zenoh_cbef.tracking.filters.rows import Rows
from zenoh_cbef.tracking.ranging import Measurement, Space

SLOT = 7
"""Numbers that an agent tells: 1, its position (3), its range, its age and its noise."""

_OFF = 5.0
"""By how many deviations of its noise a range is off an estimate that may be wrong, or take a wrong range for right."""

_ANY = 1e-9
"""More than rounding leaves of an average of zeros."""


@dataclass(frozen=True)
class Slots:
    """Places for the ranges of n agents. range_std: sigma (m). middle: from which positions are counted, m.

    least: ranges below it, m, are none.
    """

    space: Space
    range_std: float
    middle: tuple[float, ...]
    network_size: int
    least: float = -np.inf

    def of(self, measurement: Measurement) -> Rows:
        """Which place each agent has in a payload, (n,)."""
        if measurement.agent is None:
            raise ValueError("agents that tell each other their ranges have to know their numbers")
        return measurement.agent.astype(np.intp) % self.network_size

    def told(self, measurement: Measurement) -> Floats:
        """What agents tell, (n, SLOT): zeros where they have no range."""
        there = self._heard(measurement.range)
        std = np.sqrt(variance_of(measurement, self.range_std))
        last = np.where(there, measurement.range, 0.0), measurement.age, std
        slot = np.concatenate([np.ones((len(there), 1)), measurement.position, np.stack(last, axis=1)], axis=1)
        return np.where(there[:, None], slot, 0.0)

    def heard(self, averages: Floats, alone: Bools) -> Heard:
        """What agents know of all ranges, nothing if they were alone. averages: (n, network_size * SLOT)."""
        slots = averages.reshape(-1, self.network_size, SLOT)
        share = slots[:, :, :1]
        there = (np.abs(share) > _ANY) & ~alone[:, None, None]
        slots = np.where(there, slots / np.where(there, share, 1.0), 0.0)
        ranges = np.where(there[:, :, 0], slots[:, :, 4], np.nan)
        return self.at(slots[:, :, 1:4], ranges, slots[:, :, 5], np.where(there[:, :, 0], slots[:, :, 6], 1.0) ** 2)

    def nothing(self, state: Floats) -> Heard:
        """What agents in these states, (n, s), know that have heard no range."""
        none = np.zeros((len(state), self.network_size))
        return self.at(np.zeros((*none.shape, 3)), none + np.nan, none, none + 1.0)

    def doubtful(self, heard: Heard, state: Floats) -> Heard:
        """The ranges of a step as those agents know them to whose estimates one does not fit; the others know none.

        state: (n, s), the estimates, their position counted from the middle. Ranges count as if they were of now.
        """
        away = state[:, None, : self.space.axes] - heard.place
        distance = np.sqrt(np.add.reduce(away * away, axis=2) + heard.height)
        off = np.abs(heard.range - distance) > _OFF * np.sqrt(heard.variance)
        return replace(heard, range=np.where(off.any(axis=1)[:, None], heard.range, np.nan))

    def own(self, measurement: Measurement) -> Heard:
        """What an agent knows of its own range alone."""
        noise = variance_of(measurement, self.range_std)
        seen = measurement.position, measurement.range, measurement.age, noise
        return self.at(*(one[:, None] for one in seen))

    def at(self, positions: Floats, ranges: Floats, age: Floats, variance: Floats) -> Heard:
        """Ranges of agents at positions (n, m, 3), by the estimated axes."""
        axes, height = self.space.axes, np.zeros_like(ranges)
        if self.space.height is not None:
            height = (self.space.height - positions[:, :, 2]) ** 2
        ranges = np.where(self._heard(ranges), ranges, np.nan)
        return Heard(positions[:, :, :axes] - np.array(self.middle), height, ranges, age, variance)

    def _heard(self, ranges: Floats) -> Bools:
        return np.isfinite(ranges) & (ranges >= self.least)
