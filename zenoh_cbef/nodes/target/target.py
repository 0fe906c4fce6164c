"""The target: emits the beacons, emulates what the receivers measure, lets agents in, ends the run."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from math import inf

from zenoh_cbef.errors import UserError
from zenoh_cbef.faults import Absence, SensorFault
from zenoh_cbef.nodes.common.node import Node
from zenoh_cbef.nodes.common.pace import Pace
from zenoh_cbef.nodes.common.readers import WINDOW
from zenoh_cbef.nodes.target.emission import Emission
from zenoh_cbef.nodes.target.following import Following
from zenoh_cbef.nodes.target.hold import Hold
from zenoh_cbef.nodes.target.injection import Injection, RealTime, StepTime
from zenoh_cbef.nodes.target.linking import linked_by
from zenoh_cbef.nodes.target.lookout import Lookout
from zenoh_cbef.nodes.target.progress import Progress
from zenoh_cbef.nodes.target.signalling import Signalling
from zenoh_cbef.nodes.target.strangers import Strangers
from zenoh_cbef.nodes.target.survey import Survey
from zenoh_cbef.protocol.claims import Claims
from zenoh_cbef.protocol.directory import Directory
from zenoh_cbef.protocol.keys import agent_named
from zenoh_cbef.protocol.slow import SLOW
from zenoh_cbef.protocol.tokens import is_recorder
from zenoh_cbef.scenario import Scenario
from zenoh_cbef.scenario.plan import Plan
from zenoh_cbef.scenario.world import World, make_world
from zenoh_cbef.words import first_of

_LAST_WORD_SECONDS, _ALONE_SECONDS = 5.0, 30.0
_LOOK_SECONDS = 0.02
_NAMED = 5
_LONGER = 4.0
"""The target's patience as a multiple of the agents' own, whose waits may follow one after the other."""


@dataclass
class Target:
    """The target of a run.

    recorded: the measurements come from a log, and no fault changes them. receivers: real ones publish the beacons.
    wait_for: how many agents have to be ready for the run to start, None: all. report: is told in words what the target
    waits for, and how far the run is.
    """

    node: Node
    plan: Plan
    world: World
    recorded: bool = False
    wait_for: int | None = None
    receivers: bool = False
    report: Callable[[str], None] | None = None

    def __post_init__(self) -> None:
        realtime = self.plan.realtime
        self._emission = Emission(self.node, self.plan, receivers=self.receivers)
        self._signals = Signalling(self.node, self.scenario.count)
        keys = self.node.keys
        self.node.archive.serve(keys.truth, keys.faults, keys.all_beacons, keys.all_signals)
        grace = 0.0 if realtime else self.node.grace * self._patience
        # In realtime agents keep time by themselves, and may be ahead of a target that is slow.
        begun = self.scenario.length if realtime else 0
        self.claims = Claims(self.node.presence)
        silent = inf if self.receivers and not realtime else self._patience  # a source may be silent for long
        self.progress = Progress(self.node, self.scenario.count, silent, grace, claims=self.claims, begun=begun)
        self.directory = Directory(self.claims, linked_by(self.plan.edges))
        self.following = Following(self.node, self.progress, self.scenario.count * (self.plan.rounds + 3))
        self.survey = Survey(self.node)
        self.lookout, self._strangers = Lookout(self.node), Strangers(self.node)
        self._closed = self.plan.closed_steps
        self._epoch = self._alone_at = 0.0
        self._faults_out = self.node.outbox(self.node.keys.faults)
        self._active: set[int] = set()
        # Some steps begin together: fewer wake-ups. But receivers begin steps themselves: do not be behind them.
        self._further = 0 if self.receivers else WINDOW // 2
        timed = realtime and not self.receivers
        self._pace = Pace("the target", "steps", partial(self.node.event, SLOW)) if timed else None
        self.injection: Injection | None = None
        self.hold = Hold()
        self.step: int | None = None

    @property
    def scenario(self) -> Scenario:
        """The run's scenario, with the faults that were injected since."""
        return self.plan.scenario

    @property
    def _patience(self) -> float:
        return _LONGER * self.scenario.timing.patience

    @property
    def start(self) -> float:
        """When step 0 is or was, s since the Unix epoch, as the clock is set now."""
        return self._epoch - time.monotonic() + time.time()

    def members(self) -> list[int]:
        """The agents that take part in the run, and are here."""
        return self.progress.members()

    def wait_for_agents(self, patience: float) -> None:
        """Wait until every agent is ready, and a recorder where one is required. Raises UserError otherwise."""

        def lacking() -> list[str]:
            live = self.node.presence.names()
            recorded = sum(map(is_recorder, live)) >= self.scenario.record.awaited
            return self.progress.lacking(live, self.wait_for) + ([] if recorded else ["the recorder"])

        until = time.monotonic() + patience
        # Not at each change: with hundreds of agents there are thousands, and each look is at all of them.
        while (names := lacking()) and not self.node.stopping:
            if time.monotonic() < until:
                if self.report is not None:
                    self.report(f"waiting for {first_of(names, _NAMED)}")
                self.progress.drain()
                self._strangers.look()
                time.sleep(_LOOK_SECONDS)
                continue
            raise UserError(
                f"after {patience:g} s the run still lacks {', '.join(names)}; start what is missing with the same "
                "--run, check its --connect, or wait longer with --patience"
            )

    def run(self) -> int:
        """Emit all beacons; returns the last step emitted."""
        realtime, stopping = self.plan.realtime, lambda: self.node.stopping
        self._epoch = epoch = time.monotonic() + (self.scenario.timing.start_delay if realtime else 0.0)
        self.node.event("started", f"run {self.node.identity.run} started", at=self.start)
        self.progress.rejections.start()
        self._emission.begin()
        self.progress.begin(ready := self.progress.ready(self.node.presence.names()))
        self.step = 0
        if realtime or not self.receivers:
            clock = RealTime(epoch) if realtime else StepTime(self.scenario.dt, lambda: self.step or 0)
            self.injection = Injection(self.plan, clock)
        for agent in sorted(ready):
            self._signals.start(agent, 0, self.start)
        for step in range(1, self.scenario.length + 1):
            begin = epoch + step * self.scenario.dt
            if realtime:
                self.progress.drain()
                self._sleep_until(begin - self.plan.slot)
                going_on = self._in_company()
            else:
                self.hold.wait(self.survey.drain, stopping)
                going_on = self.progress.wait(step - WINDOW, further=self._further) and self._await_return(step)
                self.following.wait(step, self.survey.drain)
            if self.node.stopping or not (going_on or self._agent_returns(step)):
                break
            self.survey.drain()
            self._strangers.look()
            self._inject()
            self._announce_faults(step)
            self._admit(step)
            self.lookout.look(self.plan, self._taking_part(step), step)
            if realtime:
                self._sleep_until(begin)
            self._emission.emit(self.world, step, self._faults_out.sent, by_rounds=self.hold.by_rounds)
            if self._pace is not None:
                self._pace.arrive(time.monotonic(), begin + self.plan.deadline(0))
            self.progress.excuse(self.plan.absences.at(step), step)
            self.step = step
            if self.report is not None:
                self.report(f"step {step} of {self.scenario.length}")
            for round_ in self.hold.rounds(self.plan.rounds, self.survey.drain, stopping):
                self._signals.round(step, round_)
        self._end(self.step)
        return self.step

    def _taking_part(self, step: int) -> list[int]:
        """The agents that take part in a step: here, not silent, and not taken away by a fault."""
        idle = {*self.progress.silent(), *self.plan.absences.at(step).nonzero()[0].tolist()}
        return [agent for agent in self.members() if agent not in idle]

    def _inject(self) -> None:
        """Publish new injected faults, and act on them."""
        news = None if self.injection is None else self.injection.news()
        if self.injection is None or news is None:
            return
        self._faults_out.send(tables=news)
        former, self.plan = self.scenario, self.injection.plan
        touched = [one for one in (*former.fault, *self.scenario.fault) if isinstance(one, SensorFault | Absence)]
        if (touched or former.target != self.scenario.target) and not self.recorded:
            self.world = make_world(self.scenario)

    def _announce_faults(self, step: int) -> None:
        """Tell the log which faults begin and end."""
        on = {index for index, fault in enumerate(self.scenario.fault) if fault.active(step * self.scenario.dt)}
        for index in sorted(on ^ self._active):
            word, kind = "begins" if index in on else "ends", self.scenario.fault[index].kind
            self.node.event(
                "fault", f"fault {index} ({kind}) {word} at step {step}", fault=index, step=step, on=index in on
            )
        self._active = on

    def _agent_returns(self, step: int) -> bool:
        absences = self.plan.absences
        return any(absences.return_of(one, step) is not None for one in absences.at(step - 1).nonzero()[0].tolist())

    def _await_return(self, step: int) -> bool:
        """In lockstep, wait for the agents that the scenario has started again for this step."""
        back = self.plan.absences.reborn(step).nonzero()[0].tolist()
        until = time.monotonic() + self._patience

        def lacking() -> list[int]:
            # An agent that still takes part is not back: the target is some steps ahead of its end.
            return [agent for agent in back if agent not in self.progress.newcomers()]

        while back and lacking() and not self.node.stopping:
            if time.monotonic() > until:
                names = ", ".join(f"agent {agent}" for agent in lacking())
                self.node.event(
                    "silent", f"{names} did not come back for step {step}; the run goes on without", step=step
                )
                return True
            self.node.presence.wait(lambda _live: not lacking(), 0.1)
            self.progress.drain()
        return True

    def _admit(self, step: int) -> None:
        """Let agents that came since begin with this step, unless the scenario has them away."""
        if step <= self._closed + 1:
            return
        for agent in self.progress.newcomers():
            if not self.plan.absences.at(step)[agent]:
                planned = bool(self.plan.absences.ended(step)[agent])
                self.progress.admit(agent, step)
                self.node.event(
                    "joined", f"agent {agent} joined at step {step}", agent=agent, step=step, planned=planned
                )
                self._signals.start(agent, step - 1, self.start)

    def _in_company(self) -> bool:
        """Whether any agent takes part, or did so lately: a target without agents may be behind a broken link."""
        now = time.monotonic()
        if self.members():
            self._alone_at = now
        return now - self._alone_at <= (0.0 if self.node.launched else _ALONE_SECONDS)

    def _sleep_until(self, moment: float) -> None:
        while not self.node.stopping and (left := moment - time.monotonic()) > 0.0:
            time.sleep(min(left, 0.1))

    def _end(self, last: int) -> None:
        """No more beacons: agents finish the step they are in, so that a stopped run, too, can be verified."""
        self.progress.wait(last, even_stopping=True)
        if not self.plan.realtime:
            self.following.finish(last)
        self._signals.end(last + 1)
        boxes = [*self._emission.boxes, *self._signals.boxes]
        self.progress.rejections.report()
        self.node.last_words(
            "finished",
            f"the target ended after step {last}",
            step=last,
            sent={box.key: box.sent for box in boxes},
            rejected=self.progress.rejections.total,
            **({} if self._pace is None else self._pace.finish()),
        )
        # Agents wait for the end signal only while the target is there.
        self.node.presence.wait(lambda live: all(agent_named(name) is None for name in live), _LAST_WORD_SECONDS)
