"""How far the agents of a run are, as their estimates show, and which of them take part."""

from __future__ import annotations

import time
from collections import deque

from zenoh_cbef.arrays import Bools
from zenoh_cbef.nodes.common.alarm import Alarm
from zenoh_cbef.nodes.common.node import Node
from zenoh_cbef.nodes.common.rejections import Rejections
from zenoh_cbef.protocol.claims import Claims
from zenoh_cbef.protocol.fair_mailbox import FairMailbox
from zenoh_cbef.protocol.keys import address, agent_named
from zenoh_cbef.protocol.kinds import ESTIMATE
from zenoh_cbef.protocol.memory import ask_latest
from zenoh_cbef.protocol.messages import BadMessage, peek
from zenoh_cbef.protocol.tokens import ready_token

_GATHER_SECONDS, _MOST_GATHER_SECONDS = 0.001, 0.02
"""How long estimates gather at least and at most: a wake-up for each would cost more than reading it."""
_PORTION = 10_000
_WAITING = 1 << 12
_ROOM = 16
"""Estimates that can wait: of each agent more than it can be ahead, and some of a flood."""
_KEPT = 8
"""Estimates of each agent that are kept: more than agents can be apart."""
_ASK_SECONDS, _ASKED = 2.0, 4
"""How often the slowest agents are asked for estimates that may be lost, and how many of them."""
_LOOK_BACK = 6
"""Estimates of each agent that are kept from the last seconds, one of each."""


class Progress:
    """How far the agents are. It does not wait for an agent that left, or is not there for a while.

    patience, grace: how long (s) an agent that is there may not get on, or be out of sight, before it is taken to be
    gone. claims: of names in this run. begun: the last step that an agent can have come to; it grows with the steps
    that the target begins.
    """

    def __init__(self, node: Node, count: int, patience: float, grace: float, *, claims: Claims, begun: int) -> None:
        self._node, self._patience, self._grace, self._claims = node, patience, grace, claims
        self._lives = [""] * count
        self._last_seen: dict[int, float] = {}
        self._away: set[int] = set()
        self._alarm = Alarm()
        self.rejections = Rejections(node)
        self._begun = begun
        self._changed = True
        self._gained, self._gained_at, self._step_seconds = 0, 0.0, 0.0
        self._reached = [0] * count
        self._silent: set[int] = set()
        self._recent: list[deque[tuple[int, bytes]]] = [deque(maxlen=_KEPT) for _ in range(count)]
        self._past: list[deque[tuple[float, bytes]]] = [deque(maxlen=_LOOK_BACK) for _ in range(count)]
        self._members = set(range(count))
        self._mailbox = FairMailbox(node.session, node.keys.all_estimates, _WAITING + _ROOM * count)
        node.presence.on_change(self._note_change)
        node.on_stop(self._mailbox.wake)

    def _note_change(self, name: str, joined: bool) -> None:
        agent = agent_named(name)
        if agent is not None and joined:
            self._last_seen.pop(agent, None)
        elif agent is not None and agent < len(self._reached):
            self._last_seen[agent] = time.monotonic()
        self._changed = True
        self._mailbox.wake()

    def _dismiss(self) -> None:
        """End the part of agents that have left, were started again, or are out of sight for too long."""
        if not (self._changed or self._last_seen):
            return
        self._changed = False
        for agent in list(self._members):
            name = f"agent/{agent}"
            life, gone = self._node.presence.life(name), self._last_seen.get(agent)
            hope = self._grace and agent not in self._away and not self._node.presence.is_over(name)
            lost = gone is not None and not (hope and time.monotonic() < gone + self._grace)
            if lost or life != (self._lives[agent] or life):
                self._members.discard(agent)
                self._lives[agent] = ""
            else:
                self._lives[agent] = life

    def ready(self, live: set[str]) -> set[int]:
        """The agents that are here and ready, by the names that are there, but none of an earlier run of this name."""
        # Of one that dies the tokens go one after the other.
        ready = {one for one in range(len(self._reached)) if {f"agent/{one}", ready_token(one)} <= live}
        lives = self._node.presence.lives(live)
        return {one for one in ready if lives[f"agent/{one}"] == self._claims.given(f"agent/{one}")}

    def lacking(self, live: set[str], enough: int | None) -> list[str]:
        """What the run lacks to start, of agents, in words. enough: how many have to be ready, None for all."""
        ready = self.ready(live)
        if enough is not None and len(ready) >= enough:
            return []
        unready = [agent for agent in range(len(self._reached)) if agent not in ready]
        absent = [f"agent {one}" for one in unready if f"agent/{one}" not in live]
        return absent or [f"agent {one} (here, but not linked to all it needs)" for one in unready]

    def begin(self, ready: set[int]) -> None:
        """Start the run with the agents that are ready."""
        self._members, self._changed = set(ready), True

    def members(self) -> list[int]:
        """The agents that take part, and are here."""
        self._dismiss()
        return sorted(self._members)

    def newcomers(self) -> list[int]:
        """The agents that are here and ready, but do not take part yet."""
        self._dismiss()
        complete = len(self._members) == len(self._reached)
        return [] if complete else sorted(self.ready(self._node.presence.names()) - self._members)

    def admit(self, agent: int, step: int) -> None:
        """An agent takes part from a step on."""
        self._members.add(agent)
        self._changed = True
        self._silent.discard(agent)
        self._reached[agent] = max(self._reached[agent], step - 1)

    def excuse(self, absent: Bools, step: int) -> None:
        """A step has begun: do not wait for its estimates from agents (n,) that are not there in it."""
        self._begun = max(self._begun, step)
        self._away = set(absent.nonzero()[0].tolist())
        for agent in self._away:
            self._reached[agent] = max(self._reached[agent], step)

    def _slowest(self) -> int | None:
        """The step that every agent here that is not silent has finished; None where all are."""
        return min((self._reached[agent] for agent in self.members() if agent not in self._silent), default=None)

    def silent(self) -> list[int]:
        """The agents that are here, but for which the target no longer waits."""
        return sorted(self._silent & set(self.members()))

    def heard(self) -> dict[int, int]:
        """The step of the last estimate that came from each agent that takes part."""
        return {agent: recent[-1][0] for agent in self.members() if (recent := self._recent[agent])}

    def estimates(self) -> list[tuple[int, bytes]]:
        """Every agent's estimate as it came, and its step: that of the last step that all have done, or the last."""
        common = self._slowest() or 0
        kept = [list(recent) for recent in self._recent]
        return [next((one for one in recent if one[0] == common), recent[-1]) for recent in kept if recent]

    def earlier(self) -> list[bytes]:
        """An estimate of every agent from some five seconds before its last one, or the first that came since."""
        return [past[0][1] for past in map(list, self._past) if past]

    def wait(self, step: int, *, further: int = 0, even_stopping: bool = False) -> bool:
        """Wait until every agent has finished a step; False where the run has no agents or is told to stop.

        further: where it has to wait, it does so for so many steps more: then it need not wait before each of them.
        It stops waiting for an agent that makes no progress for longer than the agents' own patience, until the agent
        goes on. When no agent makes progress for twice as long, the run is over.
        """
        until, ask_at = time.monotonic() + self._patience, time.monotonic() + _ASK_SECONDS
        waited = False
        while self.members() and (even_stopping or not self._node.stopping):
            slowest = self._slowest()
            if slowest is not None and slowest >= step:
                if waited:
                    self._note_pace(slowest)
                return True
            step, waited = step if waited else step + further, True
            if time.monotonic() >= until:
                if slowest is None:
                    return False
                self._leave_behind(slowest)
                until = time.monotonic() + self._patience
            received = self._alarm.receive_from(self._mailbox)
            if received is not None:
                self._note(*received)
                # There is time until the slowest agent is nearly there.
                late = self._step_seconds * (step - (slowest or 0) - 0.5)
                time.sleep(min(max(late, _GATHER_SECONDS), _MOST_GATHER_SECONDS))
                self.drain()
            if time.monotonic() >= ask_at:
                self._recall()
                ask_at = time.monotonic() + _ASK_SECONDS
        return False

    def _note_pace(self, slowest: int) -> None:
        """Learn how long the slowest agent takes for a step."""
        now = time.monotonic()
        if slowest > self._gained:
            self._step_seconds = (now - self._gained_at) / (slowest - self._gained) if self._gained else 0.0
        self._gained, self._gained_at = slowest, now

    def _recall(self) -> None:
        """Ask the slowest agents for their last estimates, which a flood or a broken link may have lost."""
        slowest = self._slowest()
        behind = [one for one in self.members() if one not in self._silent and self._reached[one] == slowest]
        for key in map(self._node.keys.estimate, behind[:_ASKED]):
            for data in ask_latest(self._node.session, key):
                self._note(key, data)

    def _leave_behind(self, step: int) -> None:
        behind = [agent for agent in self.members() if agent not in self._silent and self._reached[agent] == step]
        self._silent.update(behind)
        names = ", ".join(f"agent {agent}" for agent in behind)
        self._node.event("silent", f"{names} did not get beyond step {step}; the run goes on without", step=step)

    def drain(self) -> None:
        """Take in what has come, or a portion of it, without waiting."""
        for _ in range(_PORTION):
            received = self._mailbox.poll_from()
            if received is None:
                return
            self._note(*received)

    def _note(self, key: str, data: bytes) -> None:
        at = address(key)
        try:
            if at is None or at.kind != "estimate":
                raise BadMessage("not an estimate key")
            step = peek(ESTIMATE, data, run=self._node.identity.run, sender=at.owner)
            if at.agent >= len(self._reached):
                raise BadMessage("from an agent that the scenario does not have")
            if step > self._begun:
                raise BadMessage("of a step that no agent can have come to")
        except BadMessage as error:
            self.rejections.add(key, str(error))
        else:
            self._recent[at.agent].append((step, data))
            past, now = self._past[at.agent], time.monotonic()
            if not past or now - past[-1][0] >= 1.0:
                past.append((now, data))
            # An agent that sends the same step again and again makes no progress.
            if step > self._reached[at.agent]:
                self._reached[at.agent] = step
                self._silent.discard(at.agent)
