"""What misbehaving agents send in place of their messages."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Annotated

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from zenoh_cbef.arrays import Floats, Ids
from zenoh_cbef.faults.answers import asking, flaw_of_sent, refuse
from zenoh_cbef.faults.base import Fault, Seeds
from zenoh_cbef.quantities import Agent
from zenoh_cbef.tracking.moderation import LARGEST_SENT, is_within

Displaced = Callable[[Floats, Floats], Floats]
"""Messages (n, d) that say the target is elsewhere by offsets (n, 3), m."""


@dataclass(frozen=True)
class Sent:
    """One round's messages of the agents that a fault is on.

    seed, agent: (n,). step: from 1. round: 0 for ranges. elapsed: s since the fault began. message: (n, d), what the
    agents would send. past: (n, d), what they would have sent in this round `memory` steps ago. displaced: a function,
    see Displaced.
    """

    seed: Seeds
    agent: Ids
    step: int
    round: int
    elapsed: float
    message: Floats
    past: Floats
    displaced: Displaced


class SenderFault(Fault):
    """A fault of what agents send to all their neighbours. Their own estimates stay honest."""

    agents: Annotated[tuple[Agent, ...], Field(min_length=1, description="a list of agents, as in [3]")]

    @property
    def memory(self) -> int:
        """How many steps back the fault looks; 0 where it does not."""
        return 0

    def named(self) -> set[int]:
        """The agents that misbehave."""
        return set(self.agents)

    def sent(self, honest: Sent, index: int) -> Floats:
        """What is sent instead, (n, d); index: the fault's place in the scenario, for its streams."""
        raise NotImplementedError


class Outgoing:
    """What the agents of a batch really send, the same in any batch.

    faults: all of a scenario; those of senders count. seed, agent: (n,). dt: s. displaced: for consensus messages.
    rounded: what receivers take consensus messages to be, None where they are as they are.
    """

    def __init__(
        self,
        faults: Sequence[Fault],
        *,
        seed: Seeds,
        agent: Ids,
        dt: float,
        displaced: Displaced,
        rounded: Callable[[Floats], Floats] | None = None,
    ) -> None:
        self._faults: list[tuple[int, SenderFault, NDArray[np.intp]]] = []
        for index, fault in enumerate(faults):
            if isinstance(fault, SenderFault) and (rows := np.flatnonzero(np.isin(agent, fault.agents))).size:
                self._faults.append((index, fault, rows))
        self._seed, self._agent, self._dt = seed, agent, dt
        self._displaced, self._rounded = displaced, rounded
        # The honest messages of each fault's rows, by step and round, as far back as it looks.
        self._honest: list[dict[tuple[int, int], Floats]] = [{} for _ in self._faults]

    def message(self, step: int, round_: int, message: Floats) -> Floats:
        """What is sent in a round, (n, d), in place of the honest messages (n, d).

        It is bounded for honest agents, too: receivers reject more, and what liars say, or a filter that diverges, may
        lead an honest agent there. NaN, silence, stays NaN.
        """
        if self._faults:
            silent = np.isnan(message[:, 0])
            message = self._sent(step, round_, message, self._displaced)
            silent |= np.isnan(message[:, 0])
            if self._rounded is not None:
                message = self._rounded(np.where(silent[:, None], 0.0, message))
            message = np.where(silent[:, None], np.nan, message) if silent.any() else message
        return message if is_within(LARGEST_SENT, message) else np.clip(message, -LARGEST_SENT, LARGEST_SENT)

    def ranges(self, step: int, ranges: Floats) -> Floats:
        """Ranges (n,) as they are sent, m; a displaced target is farther away by the length of the displacement.

        An agent that measured nothing has nothing to falsify: NaN stays NaN.
        """
        if not self._faults:
            return ranges
        wrong = self._sent(step, 0, np.nan_to_num(ranges)[:, None], _longer)[:, 0]
        return np.where(np.isfinite(ranges), wrong, np.nan)

    def _sent(self, step: int, round_: int, message: Floats, displaced: Displaced) -> Floats:
        sent = message.copy()
        for place, (index, fault, rows) in enumerate(self._faults):
            past = self._past(place, fault.memory, step, round_, message[rows])
            time = step * self._dt
            if fault.active(time):
                honest = Sent(
                    seed=self._seed[rows],
                    agent=self._agent[rows],
                    step=step,
                    round=round_,
                    elapsed=time - fault.since,
                    message=sent[rows],
                    past=past,
                    displaced=displaced,
                )
                with asking(fault, "sent"):
                    told = fault.sent(honest, index)
                    refuse(flaw_of_sent(told, honest.message, past))
                sent[rows] = told
        return sent

    def _past(self, place: int, memory: int, step: int, round_: int, message: Floats) -> Floats:
        """The messages of the same round `memory` steps ago, or the oldest ones that are known."""
        if memory == 0:
            return message
        kept = self._honest[place]
        kept[step, round_] = message
        old = next((kept[earlier, round_] for earlier in range(step - memory, step) if (earlier, round_) in kept), None)
        kept.pop((step - memory, round_), None)
        return message if old is None else old


def _longer(ranges: Floats, offset: Floats) -> Floats:
    return np.asarray(ranges + np.sqrt(np.sum(offset * offset, axis=1))[:, None])
