"""An agent: measures, exchanges rounds with its neighbours, publishes its estimate."""

from __future__ import annotations

import time
from functools import partial
from math import nan

import numpy as np

from zenoh_cbef.faults import ahead, clocks_of
from zenoh_cbef.nodes.agent.afterwards import Afterwards
from zenoh_cbef.nodes.agent.entrance import Entry
from zenoh_cbef.nodes.agent.neighbour import Neighbourhood
from zenoh_cbef.nodes.agent.news import News
from zenoh_cbef.nodes.agent.signals import Signals
from zenoh_cbef.nodes.agent.vicinity import Vicinity
from zenoh_cbef.nodes.common.alarm import Alarm
from zenoh_cbef.nodes.common.inbox import Stopped
from zenoh_cbef.nodes.common.node import Node
from zenoh_cbef.nodes.common.own_ring import OwnRing
from zenoh_cbef.nodes.common.pace import Pace
from zenoh_cbef.nodes.common.readers import beacon_inbox
from zenoh_cbef.nodes.common.rejections import Rejections
from zenoh_cbef.nodes.common.standstill import die, stand_still
from zenoh_cbef.protocol.bodies import estimate_body, range_body
from zenoh_cbef.protocol.outbox import Outbox
from zenoh_cbef.protocol.short import codec_of
from zenoh_cbef.protocol.slow import SLOW
from zenoh_cbef.scenario.build import agent_tracker, fates_into, outgoing_of, smoother_of
from zenoh_cbef.scenario.injected import read_tables, with_faults
from zenoh_cbef.scenario.paths import agent_positions
from zenoh_cbef.scenario.plan import Plan
from zenoh_cbef.scenario.plausible import taken
from zenoh_cbef.tracking.ranging import Measurement

_LEASE_SHARE = 0.4
_PORTION_SECONDS = 0.1
_LONGER = 4.0
"""How long an agent waits for injected faults that a beacon tells of, as a multiple of its patience."""
_KEPT_BYTES = 1 << 20

_UNHEARD = nan, 0.0
"""Range (m) and age (s) where the agent's receiver heard nothing."""


class Agent:
    """One agent of a run, step after step."""

    def __init__(self, node: Node, plan: Plan, agent: int) -> None:
        self.node, self.plan, self.agent = node, plan, agent
        self._given, self.scenario = plan, plan.scenario
        scenario, realtime = plan.scenario, plan.realtime
        self.tracker, neighbours = agent_tracker(plan, agent)
        self.outgoing = outgoing_of([plan], [agent])
        self.path = agent_positions(scenario, agent)[0]
        self.rejections = Rejections(node)
        self._news = News(node, self.rejections, self.inject, _LONGER * scenario.timing.patience)
        self._lists, self._by_rounds = 0, False
        self._wrong_clocks = clocks_of(scenario.fault, agent)
        self._ahead_ns, self._isolated = 0, nan
        if self._wrong_clocks or realtime:
            node.clock = lambda: time.time_ns() + self._ahead_ns
        alarm, grace = Alarm(), 0.0 if realtime else node.grace * scenario.timing.patience
        self.beacons = beacon_inbox(node, agent, self.rejections, alarm, grace)
        self.signals = Signals(node, agent, self.rejections, self.beacons, grace)
        self.neighbourhood = Neighbourhood(
            node,
            plan,
            neighbours,
            fates_into(plan, agent, neighbours),
            rejections=self.rejections,
            alarm=alarm,
            grace=grace,
        )
        self.vicinity = Vicinity(plan, agent, neighbours, follows=node.connection.told)
        self._range_out, self._round_out, self._estimate_out = (
            node.outbox(key, may_drop=realtime, keep=_KEPT_BYTES)
            for key in (node.keys.range(agent), node.keys.round(agent), node.keys.estimate(agent))
        )
        smoother = smoother_of(plan)
        self._afterwards = None
        if smoother is not None:
            self._afterwards = Afterwards(node, agent, smoother, may_drop=realtime, keep=_KEPT_BYTES)
        node.archive.serve(node.keys.of_agent(agent))
        self._ring = None
        if scenario.record.rings:
            self._ring = OwnRing(node, agent, self._boxes(), scenario.record, may_wait=not realtime)
        self._codec = codec_of(node.identity.run, node.identity.sender, plan.message_size, plan.compact)
        self._realtime = realtime
        # Where a step's rounds last longer than the step, late neighbours hold an agent up, too.
        measurable = realtime and self.plan.deadline(self.plan.rounds) <= scenario.dt * (1.0 + 1e-9)
        self._pace = Pace(f"agent {agent}", "rounds", partial(node.event, SLOW)) if measurable else None
        self._epoch = 0.0

    @np.errstate(all="ignore")  # messages can be forged, and the tracker looks at its results
    def run(self, entry: Entry) -> int:
        """All steps until the target ends the run; returns the last one."""
        self._epoch = entry.epoch
        self._news.begin()
        if self._ring is not None:
            self._ring.begin()
        last, length = entry.before, self.scenario.length
        # One more than there are steps: leaving before all are done would look like a death to the others.
        for step in range(entry.before + 1, length + 2):
            self.vicinity.come(step)
            if self._wrong_clocks:
                self._ahead_ns = round(1e9 * ahead(self._wrong_clocks, step * self.scenario.dt))
            try:
                beacon = self._listen(step)
                if beacon is None or self.node.stopping or step > length:
                    break
                if self._realtime:
                    self._news.heed()
                elif self._news.heard < self._lists:
                    self._news.await_(self._lists, step)
                if step == entry.before + 1:
                    entry.adopt()
                self._step(step, beacon, there=not self.plan.absences.any or self._heed_absences(step))
            except Stopped:
                break
            last = step
        return last

    def inject(self, tables: str) -> None:
        """Live with these faults besides the scenario's, a JSON list of all. Raises UserError where they are none."""
        self.plan = with_faults(self._given, read_tables(tables))
        self.neighbourhood.fates = fates_into(self.plan, self.agent, self.neighbourhood.ids)
        self.outgoing = outgoing_of([self.plan], [self.agent])
        self._wrong_clocks, self._ahead_ns = clocks_of(self.plan.scenario.fault, self.agent), 0

    def _heed_absences(self, step: int) -> bool:
        """Be killed, or stopped for a while, where the scenario says so; wait for neighbours that come back.

        Returns whether the agent is there.
        """
        absences = self.plan.absences
        gone, forgotten = absences.begun(step), absences.crashed(step) & ~absences.crashed(step - 1)
        if gone[self.agent] or forgotten[self.agent]:
            if not self._realtime:
                self.neighbourhood.outwait(step, absences.at(step))
            if forgotten[self.agent]:
                self.node.last_words(
                    "killed", f"agent {self.agent} is killed at step {step}", agent=self.agent, step=step
                )
                die(step, absences.return_of(self.agent, step), self.scenario.dt if self._realtime else 0.0)
            self._pause(step)
        self.neighbourhood.expect(absences.ended(step))
        return not absences.at(step)[self.agent]

    def _pause(self, step: int) -> None:
        back = self.plan.absences.return_of(self.agent, step) or self.scenario.length
        seconds = (back - step) * self.scenario.dt
        if not self._realtime:
            # In lockstep no agent waits for wall-clock time, but a link that is silent for longer would be given up.
            seconds = min(seconds, _LEASE_SHARE * 1e-3 * self.scenario.zenoh.lease_ms)
        self.node.last_words("paused", f"agent {self.agent} is stopped at step {step}", agent=self.agent, step=step)
        stand_still(seconds)
        self.node.event("continued", f"agent {self.agent} goes on", agent=self.agent, step=step)

    def _begin(self, step: int) -> float:
        """When a step begins in realtime, s on the monotonic clock."""
        return self._epoch + step * self.scenario.dt

    def _deadline(self, step: int, round_: int) -> float:
        """When a round of a step is over in realtime, s on the monotonic clock."""
        return self._begin(step) + self.plan.deadline(round_)

    def _arrive(self, step: int, round_: int) -> float:
        """The deadline of a round that the agent comes to now. What it comes to while it is away does not count."""
        deadline = self._deadline(step, round_)
        if self._pace is not None and step <= self.scenario.length and self._is_there(step):
            self._pace.arrive(time.monotonic(), deadline)
        return deadline

    def _is_there(self, step: int) -> bool:
        return not self.plan.absences.any or not self.plan.absences.at(step)[self.agent]

    def _await(self, step: int) -> None:
        """Wait until a step may begin, a round before its time; in portions: by a wrong clock it can be hours away."""
        begin = self._begin(step) - self.plan.slot
        while (left := begin - time.monotonic()) > 0.0 and not (self.node.stopping or self.signals.over(step)):
            time.sleep(min(left, _PORTION_SECONDS))

    def _listen(self, step: int) -> tuple[float, float] | None:
        """Range (m) and age (s) of a step's beacon; None where the run has ended."""
        if self._realtime:
            # The beacon itself wakes the agent, once; only one that comes early, or never, leaves it time to wait.
            self._await(step - 1)
            message = self.beacons.take(step, self._arrive(step, 0))
            self._await(step)
        else:
            message = self.beacons.take(step)
        self._lists = 0 if message is None else message.get("lists", 0)
        self._by_rounds = message is not None and message.get("by_rounds", False)
        # Alone behind a broken link it would run to the last step at once.
        if message is None and (self.signals.over(step) or (self.node.grace and not self._realtime)):
            return None
        if message is None or message["emitted"] is None or message["arrived"] is None:
            return _UNHEARD
        beacon = taken(self.scenario, message["emitted"], message["arrived"], step)
        if not self.plan.plausible.holds(*beacon):
            self.beacons.reject("a range that is not plausible in this scenario")
            return _UNHEARD
        return beacon if self.plan.plausible.tells(beacon[0]) else _UNHEARD

    def _measure(self, step: int, beacon: tuple[float, float], *, there: bool) -> Measurement:
        """What the agent measures in a step, and what its neighbours tell it of theirs."""
        position, (range_, age) = self.path[step - 1], np.array(beacon)[:, None]
        told = self.outgoing.ranges(step, range_)
        if there:
            self._range_out.send(**range_body(step, position, told[0]))
        heard = self.neighbourhood.ranges(step, self._deadline(step, 0) if self._realtime else None)
        agent = np.array([self.agent])
        return Measurement(position[None].copy(), range_, age, *heard, step=step, agent=agent)

    def _step(self, step: int, beacon: tuple[float, float], *, there: bool) -> None:
        """One step: measure, exchange messages with the neighbours round by round, conclude, and say what came out."""
        if self.vicinity.arriving is not None and not self._realtime:
            self.neighbourhood.expect(self.vicinity.arriving)
        outgoing, deadline = self.outgoing, None
        message = self.tracker.measure(self._measure(step, beacon, there=there))
        for round_ in range(1, self.plan.rounds + 1):
            if self._by_rounds and not self._realtime:
                self.signals.await_round(step, round_)
            sent = outgoing.message(step, round_, message)
            if there:
                self._round_out.send_round(self._codec, step, round_, sent)
            if self._realtime:
                deadline = self._arrive(step, round_)
            message = self.tracker.exchange(*self.neighbourhood.round(step, round_, deadline))
        estimate, counts = self.tracker.conclude(), self.neighbourhood.take_counts()
        isolated = estimate.diagnostics.isolated[0]
        if np.isfinite(isolated) and isolated != self._isolated:
            self._name_isolated(step, isolated)
        if estimate.refused[0]:
            self.rejections.add(f"the update of agent {self.agent}", "it would have left the finite numbers")
        if there:
            plugged = self.scenario.filter.plugged
            self._estimate_out.send(**estimate_body(step, estimate, 0, self.agent, counts, plugged=plugged))
        if self._afterwards is not None:
            self._afterwards.take(step, self.tracker.belief, there=there)

    def _name_isolated(self, step: int, neighbour: float) -> None:
        """Say that the agent has isolated another neighbour."""
        self._isolated = neighbour
        text = f"agent {self.agent} leaves out agent {neighbour:.0f}, whose messages are not plausible"
        self.node.event("isolated", text, agent=self.agent, neighbour=int(neighbour), step=step)

    def _boxes(self) -> list[Outbox]:
        boxes = [self._range_out, self._round_out, self._estimate_out]
        return boxes if self._afterwards is None else [*boxes, self._afterwards.box]

    def finish(self, last: int) -> None:
        """Say what is left to say, and what was done and sent, so that the log can be checked for completeness."""
        if self._afterwards is not None and self._is_there(last):
            self._afterwards.finish()
        self.rejections.report()
        self.node.last_words(
            "finished",
            f"agent {self.agent} ended after step {last}",
            step=last,
            sent={box.key: box.sent for box in self._boxes()},
            rejected=self.rejections.total,
            **({} if self._pace is None else self._pace.finish()),
        )
        if self._ring is not None:
            self._ring.end()
