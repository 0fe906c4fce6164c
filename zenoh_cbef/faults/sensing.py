"""What faulty receivers measure in place of the true beacon ranges."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import inf
from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from zenoh_cbef.arrays import Bools, Floats, Ids
from zenoh_cbef.faults.absence import absent
from zenoh_cbef.faults.answers import asking, flaw_of_array, flaw_of_ranges, refuse
from zenoh_cbef.faults.base import Fault
from zenoh_cbef.quantities import Agent


@dataclass(frozen=True)
class Readings:
    """All ranges of one run: n agents, K steps.

    seed: the run's. agent: (n, 1). step: (K,), from 1. time: (K,), s. ranges: (n, K), m, NaN where nothing was heard.
    signal_speed: m/s. on: (n, K), where the fault is on.
    """

    seed: int
    agent: Ids
    step: Ids
    time: Floats
    ranges: Floats
    signal_speed: float
    on: Bools


class SensorFault(Fault):
    """A fault of agents' receivers: it changes their ranges, and nothing else."""

    agents: Annotated[
        Literal["all"] | tuple[Agent, ...], Field(description="'all', or a list of agents, as in [3]")
    ] = "all"

    def named(self) -> set[int]:
        """The agents that `agents` names."""
        return set() if self.agents == "all" else set(self.agents)

    def selects(self, agent: Ids) -> Bools:
        """Which agents the fault is on."""
        return np.ones(agent.shape, dtype=bool) if self.agents == "all" else np.isin(agent, self.agents)

    def measured(self, readings: Readings, index: int) -> Floats:
        """Ranges (n, K) where the fault is on; index: the fault's place in the scenario, for its streams."""
        raise NotImplementedError

    @property
    def error(self) -> float:
        """About how wrong it makes ranges, m; infinite where that is unknown."""
        return inf


def measured_ranges(faults: Sequence[Fault], ranges: Floats, *, seed: int, time: Floats, signal_speed: float) -> Floats:
    """Ranges (n, K) under a scenario's faults, which act one after the other. time: (K,), of the steps, s.

    An agent that is not there measures nothing.
    """
    count, steps = ranges.shape
    agent, step = np.arange(count)[:, None], np.arange(1, steps + 1)
    for index, fault in enumerate(faults):
        if isinstance(fault, SensorFault):
            with asking(fault, "selects"):
                chosen = fault.selects(agent)
                refuse(flaw_of_array(chosen, "selects()", agent.shape))
            on = chosen & fault.during(time)
            readings = Readings(seed, agent, step, time, ranges, signal_speed, on)
            with asking(fault, "measured"):
                told = fault.measured(readings, index)
                refuse(flaw_of_ranges(told, ranges.shape))
            ranges = np.where(on, told, ranges)
    gone = absent(faults, count, time)
    return np.where(gone, np.nan, ranges) if gone.any() else ranges
