"""Agents off the air."""

from __future__ import annotations

from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from zenoh_cbef.faults.base import Agent, Bools, Effect, Ids, MessageFault, Messages


class Outage(MessageFault):
    """Agents are silent and deaf: every message from or to them is lost. They go on tracking by themselves."""

    kind: Literal["outage"]
    agents: Annotated[tuple[Agent, ...], Field(min_length=1, description="a list of agents, as in [3]")]

    def named(self) -> set[int]:
        """The agents that are off."""
        return set(self.agents)

    def selects(self, source: Ids, destination: Ids) -> Bools:
        """Every link into or out of one of the agents."""
        return np.isin(source, self.agents) | np.isin(destination, self.agents)

    def effect(self, messages: Messages, index: int) -> Effect:  # noqa: ARG002 - nothing is drawn
        """All lost."""
        return Effect(lost=np.ones(messages.source.shape, dtype=bool))
