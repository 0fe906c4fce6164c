"""What every fault is: a frozen description of when and where, and of its effect."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, ClassVar, Literal, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field, model_validator

from zenoh_cbef.arrays import Bools, Floats, Ids
from zenoh_cbef.quantities import Agent, Seconds
from zenoh_cbef.streams import LinkStreams

Seeds = NDArray[np.uint64]


@dataclass(frozen=True)
class Messages:
    """One round's messages over directed links. seed of the run, source, destination: arrays (e,).

    step, round: whole numbers, when all of them are sent: steps from 1, round 0 for the ranges. dt: s. per_step: how
    many messages a link carries in a step; they count as sent in equal intervals of `spacing` s. number: how many a
    link has carried before this one. streams: of the links.
    """

    seed: Seeds
    source: Ids
    destination: Ids
    step: int
    round: int
    dt: float
    per_step: int
    ranges: bool
    streams: LinkStreams

    def uniform(self, purpose: str) -> Floats:
        """A uniform draw for each message, (e,), in [0, 1)."""
        return self.streams.uniform(purpose, self.step, self.round)

    @property
    def number(self) -> int:
        """The place of these messages in the sequence of their links."""
        return self.step * self.per_step + self.round - (not self.ranges)

    @property
    def spacing(self) -> float:
        """Time from one message of a link to the next, s."""
        return self.dt / self.per_step

    def when(self, number: Ids) -> tuple[Ids, Ids]:
        """Step and round of the messages with these numbers."""
        return number // self.per_step, number % self.per_step + (not self.ranges)


@dataclass(frozen=True)
class Effect:
    """What one fault does to messages, arrays (e,); None: nothing of the kind.

    lost: never arrive. delay: s. overtaken: arrive after the next message of their link. corrupted: arrive with
    flipped bytes. duplicated: arrive twice. absent: were never sent, or have no receiver, as an agent is away.
    """

    lost: Bools | None = None
    delay: Floats | None = None
    overtaken: Bools | None = None
    corrupted: Bools | None = None
    duplicated: Bools | None = None
    absent: Bools | None = None


class Fault(BaseModel):
    """A fault that is on while `from` <= time < `until` (s, run time).

    A fault of another package has its own keys in a model of its own, in a field `options`. plugin: that package, its
    version and a hash of its source; None: as they are on this host. injected: whether agents decided without it how
    they track, as those of a run do into which it is injected.
    """

    model_config = ConfigDict(extra="forbid", frozen=True, defer_build=True)

    kind: str
    since: Seconds = Field(default=0.0, alias="from")
    until: Seconds | None = None
    plugin: str | None = None
    injected: bool = False

    def active(self, time: float) -> bool:
        """Whether the fault is on at a run time (s)."""
        return time >= self.since and (self.until is None or time < self.until)

    def during(self, time: Floats) -> Bools:
        """At which run times (s) the fault is on."""
        return np.asarray((time >= self.since) & (time < (np.inf if self.until is None else self.until)))

    def named(self) -> set[int]:
        """The agents that the fault names, which the scenario must have."""
        raise NotImplementedError


class MessageFault(Fault):
    """A fault of messages on some directed links. cuts: nothing at all gets through while it is on, nor a question."""

    cuts: ClassVar[bool] = False

    @property
    def loses_all(self) -> bool:
        """Whether no message gets through while it is on."""
        return self.cuts

    def selects(self, source: Ids, destination: Ids) -> Bools:
        """Which directed links (e,) the fault is on."""
        raise NotImplementedError

    def effect(self, messages: Messages, index: int) -> Effect:
        """What happens to messages on selected links; index: the fault's place in the scenario, for its streams."""
        raise NotImplementedError


class Between(BaseModel):
    """The links from an agent of one group to an agent of another, in both directions."""

    model_config = ConfigDict(extra="forbid", frozen=True, defer_build=True)

    between: Annotated[
        tuple[tuple[Agent, ...], ...],
        Field(min_length=2, description="two or more lists of agents, as in [[0, 1, 2], [3, 4, 5]]"),
    ]

    @model_validator(mode="after")
    def _apart(self) -> Self:
        members = [agent for group in self.between for agent in set(group)]
        twice = sorted({agent for agent in members if members.count(agent) > 1})
        if twice:
            raise ValueError(f"fault.links.between has agent {twice[0]} in two groups; leave it in one")
        return self

    def selects(self, source: Ids, destination: Ids) -> Bools:
        """Which directed links (e,) lead from one group to another."""
        chosen = np.zeros(source.shape, dtype=bool)
        members = [agent for group in self.between for agent in group]
        for group in self.between:
            others = [agent for agent in members if agent not in group]
            chosen |= np.isin(source, group) & np.isin(destination, others)
        return chosen


class LinkFault(MessageFault):
    """A fault of chosen links.

    links: "all", "agent:3" (every link into or out of agent 3), directed pairs [[from, to], ...], or
    {between = [[0, 1, 2], [3, 4, 5]]}.
    """

    links: Annotated[
        Literal["all"]
        | Annotated[str, Field(pattern=r"^agent:[0-9]{1,6}$")]
        | tuple[tuple[Agent, Agent], ...]
        | Between,
        Field(description="'all', 'agent:3', pairs [[from, to], ...], or { between = [[0, 1, 2], [3, 4, 5]] }"),
    ] = "all"

    def selects(self, source: Ids, destination: Ids) -> Bools:
        """Which directed links (e,) the fault is on."""
        if self.links == "all":
            return np.ones(source.shape, dtype=bool)
        if isinstance(self.links, Between):
            return self.links.selects(source, destination)
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
        pairs = self.links.between if isinstance(self.links, Between) else self.links
        return {agent for pair in pairs for agent in pair}
