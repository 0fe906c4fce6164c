"""Agents that are cut off, and agents that are not there at all."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Annotated, ClassVar

import numpy as np
from pydantic import Field

from zenoh_cbef.arrays import Bools, Floats, Ids
from zenoh_cbef.faults.base import Effect, Fault, MessageFault, Messages
from zenoh_cbef.quantities import Agent


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
    """Agents that are not there: they send, hear and measure nothing. forgets: whether they lose their memory."""

    forgets: ClassVar[bool] = False

    def effect(self, messages: Messages, index: int) -> Effect:  # noqa: ARG002 - nothing is drawn
        """There are no such messages."""
        return Effect(absent=np.ones(messages.source.shape, dtype=bool))


class Absences:
    """When the agents of a scenario are not there, and when they come back.

    faults: all of a scenario. agents: how many there are. dt: s. steps: how many there are. any: whether an agent is
    ever not there.
    """

    def __init__(self, faults: Sequence[Fault], *, agents: int, dt: float, steps: int) -> None:
        self.any = any(isinstance(fault, Absence) for fault in faults)
        self._gone: Bools = np.broadcast_to(np.False_, (agents, steps + 1))
        self._forgotten = self._gone
        if self.any:
            time = dt * np.arange(steps + 1, dtype=np.float64)
            self._gone = absent(faults, agents, time)
            self._gone[:, 0] = False  # Every agent is there at the start.
            forgetful = [fault for fault in faults if isinstance(fault, Absence) and fault.forgets]
            self._forgotten = _lasting(absent(forgetful, agents, time) & self._gone, self._gone)

    def at(self, step: int) -> Bools:
        """Which agents (n,) are not there in a step."""
        return np.asarray(self._gone[:, step])

    @property
    def empty(self) -> int | None:
        """The first step in which no agent is there; None where there is none."""
        return int(self._gone.all(axis=0).argmax()) or None  # in step 0 all are there

    def stretches(self) -> list[tuple[int, int]]:
        """First and last step of each stretch in which the same agents are not there; all are there in the others."""
        if not self.any:
            return []
        changes = np.flatnonzero((self._gone[:, 2:] != self._gone[:, 1:-1]).any(axis=0)) + 2
        parts = pairwise([1, *changes.tolist(), self._gone.shape[1]])
        return [(first, after - 1) for first, after in parts if self.at(first).any()]

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


def _lasting(begun: Bools, gone: Bools) -> Bools:
    """Where (n, K) an agent is gone and `begun` was true in this absence, in this step or before."""
    lasting = np.zeros_like(gone)
    place = np.arange(gone.shape[1])
    for agent in np.flatnonzero(begun.any(axis=1)):
        latest = np.maximum.accumulate(np.where(begun[agent], place, -1))
        there = np.maximum.accumulate(np.where(gone[agent], -1, place))
        lasting[agent] = gone[agent] & (latest > there)
    return lasting


def absent(faults: Sequence[Fault], agents: int, time: Floats) -> Bools:
    """Which of n agents are not there at run times (K,), s; (n, K)."""
    gone = np.zeros((agents, len(time)), dtype=bool)
    for fault in faults:
        if isinstance(fault, Absence):
            gone |= np.isin(np.arange(agents), fault.agents)[:, None] & fault.during(time)
    return gone
