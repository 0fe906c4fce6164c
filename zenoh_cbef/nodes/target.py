"""The target process: emits the beacons, emulates what the receivers measure, serves the scenario, ends the run."""

from __future__ import annotations

import time
from dataclasses import dataclass

from zenoh_cbef import __version__
from zenoh_cbef.errors import UserError
from zenoh_cbef.nodes.inbox import Alarm
from zenoh_cbef.nodes.neighbour import WINDOW
from zenoh_cbef.nodes.node import Identity, Node
from zenoh_cbef.nodes.rejections import Rejections
from zenoh_cbef.protocol.keys import address
from zenoh_cbef.protocol.mailbox import Mailbox
from zenoh_cbef.protocol.messages import BadMessage, nan_to_nil, peek
from zenoh_cbef.protocol.scenario_service import ScenarioText, serve_scenario
from zenoh_cbef.scenario import Scenario
from zenoh_cbef.scenario.load import Loaded, to_toml
from zenoh_cbef.scenario.world import World, make_world

_LAST_WORD_SECONDS = 5.0
_GATHER_SECONDS = 0.001
_LONGER = 4.0
"""The target's patience over the agents' own, who may have to lose it one after the other."""


class _Progress:
    """How far the agents are, by their estimates; agents that left are not waited for."""

    def __init__(self, node: Node, count: int, patience: float) -> None:
        self._node, self._patience = node, patience
        self._alarm = Alarm()
        self.rejections = Rejections(node)
        self._reached = [0] * count
        self._silent: set[int] = set()
        self._mailbox = Mailbox(node.session, node.keys.all_estimates)
        node.presence.on_change(lambda _name, _joined: self._mailbox.wake())
        node.on_stop(self._mailbox.wake)

    def anyone(self) -> bool:
        """Whether an agent is still here."""
        return bool(self._here())

    def _here(self) -> list[int]:
        return [agent for agent in range(len(self._reached)) if f"agent/{agent}" in self._node.presence]

    def _slowest(self) -> int | None:
        """The step that every agent here that is not silent has finished; None where all are."""
        return min((self._reached[agent] for agent in self._here() if agent not in self._silent), default=None)

    def wait(self, step: int, *, even_stopping: bool = False) -> bool:
        """Wait until every agent has finished a step; False where the run has no agents or is told to stop.

        Agents that do not get on for longer than the agents' own patience are waited for no more until they do. When
        that is all of them, and goes on for as long again, the run is over.
        """
        until = time.monotonic() + self._patience
        while self.anyone() and (even_stopping or not self._node.stopping):
            slowest = self._slowest()
            if slowest is not None and slowest >= step:
                return True
            if time.monotonic() >= until:
                if slowest is None:
                    return False
                self._leave_behind(slowest)
                until = time.monotonic() + self._patience
            received = self._alarm.limit(self._mailbox.receive_from, self._mailbox, None)
            if received is not None:
                self._note(*received)
                # The window leaves time to let the others' estimates gather: a wake-up each would cost more.
                time.sleep(_GATHER_SECONDS)
                self.drain()
        return False

    def _leave_behind(self, step: int) -> None:
        behind = [agent for agent in self._here() if agent not in self._silent and self._reached[agent] == step]
        self._silent.update(behind)
        names = ", ".join(f"agent {agent}" for agent in behind)
        self._node.event("silent", f"{names} did not get beyond step {step}; the run goes on without", step=step)

    def drain(self) -> None:
        """Take in what has come, without waiting."""
        while (received := self._mailbox.poll_from()) is not None:
            self._note(*received)

    def _note(self, key: str, data: bytes) -> None:
        at = address(key)
        try:
            if at is None or at.kind != "estimate":
                raise BadMessage("not an estimate key")
            message = peek("estimate", data, run=self._node.identity.run, sender=at.owner)
            agent = int(at.owner.removeprefix("agent/"))
            if agent >= len(self._reached):
                raise BadMessage("from an agent that the scenario does not have")
        except BadMessage as error:
            self.rejections.add(key, str(error))
        else:
            self._reached[agent] = max(self._reached[agent], message["k"])
            self._silent.discard(agent)


@dataclass
class Target:
    """The target of a run."""

    node: Node
    scenario: Scenario
    world: World

    def __post_init__(self) -> None:
        agents = range(self.scenario.count)
        realtime = self.scenario.timing.mode == "realtime"
        self._truth = self.node.outbox(self.node.keys.truth, may_drop=realtime)
        self._beacons = [self.node.outbox(self.node.keys.beacon(agent), may_drop=realtime) for agent in agents]
        self._progress = _Progress(self.node, self.scenario.count, _LONGER * self.scenario.timing.patience)

    def wait_for_everybody(self, patience: float) -> None:
        """Wait until every agent is ready, and a recorder where one is required. Raises UserError otherwise."""
        ready = {f"ready/{agent}" for agent in range(self.scenario.count)}
        needs_recorder = self.scenario.record.required

        def missing(live: set[str]) -> list[str]:
            recorded = not needs_recorder or any(name.startswith("record/") for name in live)
            unready = [name.replace("ready/", "agent/") for name in sorted(ready - live)]
            absent = [name for name in unready if name not in live]
            others = absent or [f"{name} (here, but not linked to all it needs)" for name in unready]
            return [name.replace("/", " ") for name in others] + ([] if recorded else ["the recorder"])

        everybody = self.node.wait_for(lambda live: not missing(live), patience, self._progress.drain)
        if not everybody and not self.node.stopping:
            names = ", ".join(missing(self.node.presence.names()))
            raise UserError(
                f"after {patience:g} s the run still lacks {names}; start what is missing with the same --run, "
                "check its --connect, or wait longer with --patience"
            )

    def run(self) -> int:
        """Emit all beacons; returns the last step emitted."""
        realtime = self.scenario.timing.mode == "realtime"
        start = time.time() + (self.scenario.timing.start_delay if realtime else 0.0)
        epoch = start - time.time() + time.monotonic()
        self.node.event("started", f"run {self.node.identity.run} started", at=start)
        self._progress.rejections.start()
        for beacon in self._beacons:
            beacon.send(k=0, emitted=None, arrived=None, signal="start", at=start)
        last = 0
        for step in range(1, self.scenario.length + 1):
            if realtime:
                self._progress.drain()
                self._sleep_until(epoch + step * self.scenario.dt)
                if self.node.stopping or not self._progress.anyone():
                    break
            elif not self._progress.wait(step - WINDOW):
                break
            self._emit(step)
            last = step
        self._end(last)
        return last

    def _sleep_until(self, moment: float) -> None:
        while not self.node.stopping and (left := moment - time.monotonic()) > 0.0:
            time.sleep(min(left, 0.1))

    def _emit(self, step: int) -> None:
        self._truth.send(k=step, state=self.world.truth[step - 1].tolist())
        for agent, beacon in enumerate(self._beacons):
            emitted, arrived = self.world.emitted[agent, step - 1], self.world.arrived[agent, step - 1]
            beacon.send(k=step, emitted=nan_to_nil(emitted), arrived=nan_to_nil(arrived))

    def _end(self, last: int) -> None:
        """No more beacons: agents finish the step they are in, so that a stopped run, too, can be verified."""
        self._progress.wait(last, even_stopping=True)
        for beacon in self._beacons:
            beacon.send(k=last + 1, emitted=None, arrived=None, signal="end")
        boxes = [self._truth, *self._beacons]
        self._progress.rejections.report()
        self.node.last_words(
            f"the target ended after step {last}",
            step=last,
            sent={box.key: box.sent for box in boxes},
            rejected=self._progress.rejections.total,
        )
        # Agents wait for the end signal only while the target is there.
        self.node.presence.wait(lambda live: not any(name.startswith("agent/") for name in live), _LAST_WORD_SECONDS)


def run_target(identity: Identity, loaded: Loaded) -> int:
    """Run the target process of a scenario to its end; returns the last step."""
    with Node(identity) as node:
        node.refuse_twin()
        text = ScenarioText(loaded.source, to_toml(loaded.scenario), __version__)
        service = serve_scenario(node.session, identity.run, text)
        target = Target(node, loaded.scenario, make_world(loaded.scenario))
        node.presence.announce(f"target/{identity.name}")
        target.wait_for_everybody(identity.patience)
        last = 0 if node.stopping else target.run()
        service.undeclare()
        node.presence.withdraw()
    return last
