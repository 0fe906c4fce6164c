"""How an agent gets into its run: at the start together with all others, or when it is under way."""

from __future__ import annotations

import time
from collections.abc import Callable, Collection, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from typing import Protocol

import numpy as np

from zenoh_cbef.nodes.agent.neighbour import Neighbourhood
from zenoh_cbef.nodes.agent.signals import Signals
from zenoh_cbef.nodes.agent.vicinity import Vicinity
from zenoh_cbef.nodes.common.briefing import introduce
from zenoh_cbef.nodes.common.inbox import MISSED, Inbox
from zenoh_cbef.nodes.common.node import Node
from zenoh_cbef.nodes.common.rejections import Rejections
from zenoh_cbef.protocol.kinds import ESTIMATE, BeaconMessage, EstimateMessage, SignalMessage
from zenoh_cbef.protocol.memory import ask_latest
from zenoh_cbef.protocol.messages import BadMessage, decode, unpack_floats
from zenoh_cbef.protocol.scenario_service import Clock, measure_clock
from zenoh_cbef.protocol.shares import is_share, records
from zenoh_cbef.protocol.tokens import is_recorder, ready_token
from zenoh_cbef.scenario.plan import Plan
from zenoh_cbef.tracking.filters import Belief
from zenoh_cbef.tracking.newcomer import belief_from
from zenoh_cbef.tracking.tracker import Tracker

_JOIN_SECONDS = 1.0
_ANSWER_SECONDS = 5.0
_LOOK_SECONDS = 0.2
_SET_SECONDS = 1.0
"""By how much the clocks and the start signal may differ on when the run starts."""
_RETURN_SECONDS = 2.0
"""For how long an agent waits for a target that is out of sight before the start, s: a link or router can come back."""


@dataclass(frozen=True)
class Entry:
    """before: the step before an agent's first one. epoch: when step 0 is or was, s on the monotonic clock.

    adopt: takes over what neighbours know, once the faults that begin with the first step are known; they say who can
    tell it.
    """

    before: int
    epoch: float
    adopt: Callable[[], None] = lambda: None


class Entrant(Protocol):
    """The parts of an agent that its entrance needs."""

    node: Node
    plan: Plan
    agent: int
    tracker: Tracker
    beacons: Inbox[BeaconMessage]
    signals: Signals
    neighbourhood: Neighbourhood
    vicinity: Vicinity
    rejections: Rejections


class Entrance:
    """Waits for the start.

    members: the agents that take part in a run that is under way, None before its start. clock: ours against the
    target's.
    """

    def __init__(self, entrant: Entrant, members: Collection[int] | None, clock: Clock | None) -> None:
        self._of, self._members, self._clock = entrant, members, clock
        self._node, self._neighbourhood = entrant.node, entrant.neighbourhood

    def wait(self) -> Entry | None:
        """Wait until all processes that the agent deals with are there, then for the target's start signal.

        None where the run ends before. An agent that comes later begins with its neighbours' estimates.
        """
        if not self._meet():
            return None
        if self._members is not None:
            self._ask(None)  # The answers show that the neighbours know of our subscriptions.
        introduce(self._node.identity, self._clock, self._node.event)
        self._node.presence.announce(ready_token(self._of.agent))
        start = self._signal()
        if start is None:
            return None
        epoch = self.epoch(start.get("at"), start["sent"])
        self._neighbourhood.drain(start["k"])
        self._neighbourhood.look_around()
        self._of.rejections.start()
        if self._members is None or start["k"] == 0:
            return Entry(start["k"], epoch)
        if not self._of.plan.realtime:
            return Entry(start["k"], epoch, partial(self._adopt, start["k"]))
        self._adopt(start["k"])
        return Entry(start["k"], epoch)

    def epoch(self, at: float | None, sent: int) -> float:
        """When step 0 is or was. Steps are counted on the monotonic clock: one that is set must not move them.

        at: what the target said of it, s; sent: when it said so, ns.
        """
        if at is None:
            return time.monotonic()
        left, told = seconds_until(at, self._clock), at - 1e-9 * sent
        if abs(left - told) > _SET_SECONDS:
            # One of the clocks was set since they were compared.
            clock = measure_clock(self._node.session, self._node.identity.run)
            left = told if clock is None else seconds_until(at, clock)
        return time.monotonic() + left

    def _meet(self) -> bool:
        linked = self._of.vicinity.wanted()
        others = [one for one in linked if self._members is None or one in self._members]
        needed = {"target/target"} | {f"agent/{other}" for other in others}
        awaited = self._of.plan.scenario.record.awaited

        def complete(live: set[str]) -> bool:
            recorders = [*filter(is_recorder, live)]
            # A recorder of some agents is linked to those alone, and to the target, which waits for all.
            own = any(is_share(name) and records(name, self._of.agent) for name in recorders)
            return needed <= live and (own or len(recorders) >= awaited)

        def drain() -> None:
            while self._of.beacons.next(0.0) is not None:
                pass
            self._neighbourhood.drain(0 if self._members is None else self._of.plan.scenario.length)

        if self._members is None:
            return self._wait_with_target(complete, drain)
        # Some agents may have left a moment ago; the run goes on without them, and so do we.
        self._node.wait_for(complete, _JOIN_SECONDS, drain)
        return not self._node.stopping and "target/target" in self._node.presence

    def _wait_with_target(self, complete: Callable[[set[str]], bool], meanwhile: Callable[[], None]) -> bool:
        """Wait until all are there; False where the target leaves for good before that, or this process is to stop."""
        last_seen = time.monotonic()  # it has told the scenario
        while not self._node.stopping:
            if self._node.wait_for(complete, _LOOK_SECONDS, meanwhile):
                return True
            if "target/target" in self._node.presence:
                last_seen = time.monotonic()
            elif time.monotonic() - last_seen > _RETURN_SECONDS:
                return False
        return False

    def _signal(self) -> SignalMessage | None:
        while not self._node.stopping and "target/target" in self._node.presence:
            start = self._of.signals.start(0.1)
            if start is not None or self._of.signals.over():
                return start
            if self._members is None:
                self._neighbourhood.drain()
        return None

    def _ask(self, step: int | None) -> dict[int, EstimateMessage]:
        """The estimates of a step (None: the last ones) of the neighbours that answer."""
        told = {}
        for other in self._neighbourhood.ids:
            sender = f"agent/{other}"
            answers = []
            if sender in self._node.presence:
                answers = ask_latest(self._node.session, self._node.keys.estimate(other), step)
            for data in answers:
                with suppress(BadMessage):
                    told[other] = decode(ESTIMATE, data, run=self._node.identity.run, sender=sender)
        return told

    def _adopt(self, before: int) -> None:
        """Begin with the neighbours' estimates: in lockstep of exactly those that can answer in the scenario."""
        ids, absent = self._neighbourhood.ids, self._of.plan.absences.at(before)
        reaches = self._neighbourhood.fates.reaches(before + 1)
        wanted = {other for other, open_ in zip(ids, reaches, strict=True) if open_ and not absent[other]}
        exact = not self._of.plan.realtime
        until = time.monotonic() + (_ANSWER_SECONDS if exact else _JOIN_SECONDS)
        told: dict[int, EstimateMessage] = {}
        while not wanted <= told.keys() and time.monotonic() < until and not self._node.stopping:
            told |= self._ask(before if exact else None)
            time.sleep(0.01)
        if exact and (mute := sorted(wanted - told.keys())):
            names = ", ".join(f"agent {other}" for other in mute)
            text = f"agent {self._of.agent} begins without what {names} knew at step {before}"
            self._node.event(MISSED, text, step=before)
        tracker, answers = self._of.tracker, {other: told[other] for other in wanted & told.keys()}
        guess = self._of.plan.guessed_at
        belief = neighbours_belief(tracker, ids, answers) if answers else guess(tracker.belief, before)
        tracker.adopt(belief, np.ones(1, dtype=bool))


def seconds_until(at: float, clock: Clock | None) -> float:
    """How far off a moment of the target's clock is, s. clock: ours against the target's."""
    return (at if clock is None else clock.ours(at)) - time.time()


def neighbours_belief(tracker: Tracker, ids: Sequence[int], told: Mapping[int, EstimateMessage]) -> Belief:
    """The belief with which a tracker begins, from its neighbours' estimates by their ids."""
    known = np.array([[other in told for other in ids]], dtype=bool).reshape(1, len(ids))
    states, covariances = np.zeros((1, len(ids), 6)), np.zeros((1, len(ids), 6, 6))
    bare = False
    for place, other in enumerate(ids):
        if other in told:
            states[0, place], packed = told[other]["state"], told[other]["covariance"]
            bare |= packed is None
            if packed is not None:
                covariances[0, place] = unpack_floats(packed, 6, 6)
    return belief_from(tracker.space, states, None if bare else covariances, known, tracker.belief)
