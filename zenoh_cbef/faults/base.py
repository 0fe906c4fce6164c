"""What every fault is: a frozen description of when and where, and of its effect."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field

Bools = NDArray[np.bool_]
Floats = NDArray[np.float64]
Ids = NDArray[np.int64]
Seeds = NDArray[np.uint64]

Agent = Annotated[int, Field(ge=0)]
Seconds = Annotated[float, Field(ge=0.0, allow_inf_nan=False)]


@dataclass(frozen=True)
class Messages:
    """One round's messages over directed links, all arrays (e,): whose, from where to where, and when sent."""

    seed: Seeds
    source: Ids
    destination: Ids
    step: int
    round: int


@dataclass(frozen=True)
class Fate:
    """What the faults do to messages: lost, (e,), and delay in seconds, (e,)."""

    lost: Bools
    delay: Floats


class Fault(BaseModel):
    """A fault that is on while `from` <= time < `until` (s, run time)."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    kind: str
    since: Seconds = Field(default=0.0, alias="from")
    until: Seconds | None = None

    def active(self, time: float) -> bool:
        """Whether the fault is on at a run time (s)."""
        return time >= self.since and (self.until is None or time < self.until)

    def named(self) -> set[int]:
        """The agents that the fault names, which the scenario must have."""
        raise NotImplementedError


class LinkFault(Fault):
    """A fault of links.

    links: "all", "agent:3" (every link into or out of agent 3), or directed pairs [[from, to], ...].
    """

    links: Annotated[
        Literal["all"] | Annotated[str, Field(pattern=r"^agent:[0-9]+$")] | tuple[tuple[Agent, Agent], ...],
        Field(description="'all', 'agent:3', or pairs [[from, to], ...]"),
    ] = "all"

    def selects(self, source: Ids, destination: Ids) -> Bools:
        """Which directed links (e,) the fault is on."""
        if self.links == "all":
            return np.ones(source.shape, dtype=bool)
        if isinstance(self.links, str):
            agent = int(self.links.removeprefix("agent:"))
            return np.asarray((source == agent) | (destination == agent))
        chosen = np.zeros(source.shape, dtype=bool)
        for first, second in self.links:
            chosen |= (source == first) & (destination == second)
        return chosen

    def named(self) -> set[int]:
        """The agents that `links` names."""
        if self.links == "all":
            return set()
        if isinstance(self.links, str):
            return {int(self.links.removeprefix("agent:"))}
        return {agent for pair in self.links for agent in pair}

    def fate(self, messages: Messages, index: int) -> Fate:
        """The fate of messages on selected links; index: the fault's place in the scenario, for its streams."""
        raise NotImplementedError
