"""How many agents have heard the target lately, as far as each agent knows."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from zenoh_cbef.arrays import Bools, Floats, Ids
from zenoh_cbef.tracking.filters.around import roll_call
from zenoh_cbef.tracking.filters.settings import FilterSettings

_KEPT = 0.99
"""What is kept of an agent's distance from the network's average from step to step: lost messages are forgotten."""


@dataclass(frozen=True)
class Hearers:
    """Numbers in every payload that tell how many agents hear the target.

    Few agents call a roll, which counts exactly whatever the graph is. Of more agents, or where agents may keep silent
    about small changes, each tells one number,

        f_i <- h_i + 0.99 (m_i - former h_i)          m_i: its average; h_i: n of an agent that hears the target, or 0

    of which the average is how many they are: dynamic average consensus (Zhu and Martinez, Automatica 46(2), 2010),
    which also reaches agents that the rounds of one step do not.
    """

    settings: FilterSettings

    @property
    def numbers(self) -> int:
        """How many numbers a payload has more."""
        return self.settings.network_size if self.settings.calls_roll else 1

    def told(self, memory: tuple[Floats, ...], agent: Ids | None, lately: Bools) -> Floats:
        """What agents (n,) tell, of whom some have heard the target lately. memory: as below, or none at first."""
        if not self.settings.calls_roll:
            average, former = memory or (np.full((len(lately), 1), float(self.settings.network_size)),) * 2
            return self._own(lately) + _KEPT * (average - former)
        if agent is None:
            raise ValueError("agents that count who hears the target have numbers")
        known = memory[0] if memory else np.ones((len(lately), self.numbers))
        return roll_call.told(known, agent, lately)

    def count(self, averaged: Floats) -> Floats:
        """Of how many agents it is true, (n,)."""
        return roll_call.count(averaged, self.settings.rounds) if self.settings.calls_roll else averaged[:, 0]

    def memory(self, averaged: Floats, lately: Bools) -> tuple[Floats, ...]:
        """What agents keep until the next step."""
        if self.settings.calls_roll:
            return (roll_call.known_of(averaged),)
        most = float(self.settings.network_size)
        return np.clip(averaged, -most, 2.0 * most), self._own(lately)

    def _own(self, lately: Bools) -> Floats:
        """What stands for an agent that hears the target, (n, 1)."""
        return np.where(lately[:, None], float(self.settings.network_size), 0.0)
