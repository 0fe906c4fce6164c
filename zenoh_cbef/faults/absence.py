"""Agents that are cut off, and agents that are not there at all."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, ClassVar

import numpy as np
from pydantic import Field

from zenoh_cbef.faults.base import Agent, Bools, Effect, Fault, Floats, Ids, MessageFault, Messages


class Off(MessageFault):
    """A fault of every link into or out of some agents."""

    agents: Annotated[tuple[Agent, ...], Field(min_length=1, description="a list of agents, as in [3]")]

    cuts: ClassVar[bool] = True

    def named(self) -> set[int]:
        """The agents that are off."""
        return set(self.agents)

    def selects(self, source: Ids, destination: Ids) -> Bools:
        """Every link into or out of one of the agents."""
        return np.isin(source, self.agents) | np.isin(destination, self.agents)


class Absence(Off):
    """Agents that are not there: they send, hear and measure nothing. What they remember afterwards, kinds say."""

    forgets: ClassVar[bool] = False

    def effect(self, messages: Messages, index: int) -> Effect:  # noqa: ARG002 - nothing is drawn
        """There are no such messages."""
        return Effect(absent=np.ones(messages.source.shape, dtype=bool))


class Absences:
    """When the agents of a scenario are not there, and when they come back.

    faults: all of a scenario. agents: how many there are. dt: s. steps: how many there are.
    """

    def __init__(self, faults: Sequence[Fault], *, agents: int, dt: float, steps: int) -> None:
        time = dt * np.arange(steps + 1, dtype=np.float64)
        self._any = any(isinstance(fault, Absence) for fault in faults)
        self._gone = absent(faults, agents, time)
        self._gone[:, 0] = False  # Everybody is there at the start.
        forgetful = [fault for fault in faults if isinstance(fault, Absence) and fault.forgets]
        self._forgotten = absent(forgetful, agents, time) & self._gone
        for step in range(1, steps + 1) if forgetful else ():
            self._forgotten[:, step] |= self._forgotten[:, step - 1] & self._gone[:, step]

    def __bool__(self) -> bool:
        return self._any

    def at(self, step: int) -> Bools:
        """Which agents (n,) are not there in a step."""
        return np.asarray(self._gone[:, step])

    def begun(self, step: int) -> Bools:
        """Which agents (n,) are gone in a step, and were there in the one before."""
        return self.at(step) & ~self.at(step - 1)

    def ended(self, step: int) -> Bools:
        """Which agents (n,) are back in a step, and were not there in the one before."""
        return self.at(step - 1) & ~self.at(step)

    def crashed(self, step: int) -> Bools:
        """Which agents (n,) are not there in a step, and have forgotten everything."""
        return np.asarray(self._forgotten[:, step])

    def reborn(self, step: int) -> Bools:
        """Which agents (n,) are back in a step and remember nothing."""
        return self.ended(step) & self.crashed(step - 1)

    def return_of(self, agent: int, step: int) -> int | None:
        """The step at which an agent that is not there in a step is back; None where it does not come back."""
        there = np.flatnonzero(~self._gone[agent, step:])
        return step + int(there[0]) if there.size else None


def absent(faults: Sequence[Fault], agents: int, time: Floats) -> Bools:
    """Which of n agents are not there at run times (K,), s; (n, K)."""
    gone = np.zeros((agents, len(time)), dtype=bool)
    for fault in faults:
        if isinstance(fault, Absence):
            gone |= np.isin(np.arange(agents), fault.agents)[:, None] & fault.during(time)
    return gone
