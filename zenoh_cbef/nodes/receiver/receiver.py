"""The receiver process: ranges become beacons of a run in realtime; the steps are counted here, not by the user."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from dataclasses import dataclass

from zenoh_cbef.errors import UserError
from zenoh_cbef.nodes.common.briefing import brief
from zenoh_cbef.nodes.common.node import Identity, Node
from zenoh_cbef.nodes.receiver.formats import Ranged, ranges_in
from zenoh_cbef.nodes.receiver.sources import lines_of
from zenoh_cbef.protocol.fields import END, START
from zenoh_cbef.protocol.kinds import SIGNAL
from zenoh_cbef.protocol.mailbox import Mailbox
from zenoh_cbef.protocol.memory import ask_latest
from zenoh_cbef.protocol.messages import BadMessage, decode

_OLDEST = 2.0
"""Steps after which a range that no step took is of no use."""


@dataclass(frozen=True)
class Heard:
    """What came of a source: ranges that became beacons, of anchors that the run does not have, and other lines."""

    ranges: int
    unknown: int
    other: int


class Receiver:
    """Keeps each anchor's latest range, and publishes it as the beacon of the step that ends next.

    paced: lines are of a file, and wait until their own times.
    """

    def __init__(self, node: Node, form: str, *, paced: bool) -> None:
        self._node, self._form, self._paced = node, form, paced
        scenario = brief(node).scenario
        if scenario.timing.mode != "realtime":
            raise UserError("receivers measure now: start the target with --receivers and timing.mode = 'realtime'")
        self._dt, self._speed = scenario.dt, scenario.sensor.signal_speed
        labels = scenario.agents.labels or tuple(map(str, range(scenario.count)))
        self._agents = {label: agent for agent, label in enumerate(labels)}
        self._boxes = [node.outbox(node.keys.beacon(agent)) for agent in range(scenario.count)]
        self._latest: dict[int, tuple[float, float]] = {}
        self._lock, self._begun = threading.Lock(), threading.Event()
        self._start, self._over, self._offset = 0.0, False, None
        self._counts = [0, 0, 0]
        self._length = scenario.length
        self._signals = Mailbox(node.session, node.keys.all_signals)
        node.follow(self._signals, self._signal)
        for data in ask_latest(node.session, node.keys.signal(0)):
            self._signal(data)

    _offset: float | None

    @property
    def over(self) -> bool:
        """Whether the run is over, or this process is told to stop."""
        return self._over or self._node.stopping

    def _signal(self, data: bytes) -> None:
        try:
            message = decode(SIGNAL, data, run=self._node.identity.run, sender="target")
        except BadMessage:
            return
        if message["signal"] == START and not self._begun.is_set():
            self._start = float(message["at"])
            self._begun.set()
        self._over = self._over or message["signal"] == END

    def take(self, line: str) -> None:
        """Take in a line of the source."""
        found = ranges_in(line, self._form)
        self._counts[2] += not found
        for one in found:
            agent = self._agents.get(one.anchor)
            self._counts[0 if agent is not None else 1] += 1
            if agent is not None:
                moment = self._moment(one)
                with self._lock:
                    self._latest[agent] = moment, one.distance

    def _moment(self, one: Ranged) -> float:
        """When a range was measured, s since 1970 on this host's clock; a receiver's own clock begins anywhere."""
        now = time.time()
        if one.time is None:
            return now
        if self._offset is None:
            self._offset = now - one.time
        while self._paced and not self.over and (left := one.time + self._offset - time.time()) > 0.0:
            time.sleep(min(left, 0.1))
        return one.time + self._offset

    def publish(self) -> None:
        """Publish a beacon for every agent at the end of each step, until the run is over."""
        while not self.over and not self._begun.wait(0.1):
            pass
        step = max(1, int((time.time() - self._start) / self._dt) + 1)
        while not self.over and step <= self._length:
            left = self._start + step * self._dt - time.time()
            if left > 0.0:
                time.sleep(min(left, 0.1))
                continue
            with self._lock:
                latest, self._latest = self._latest, {}
            for agent, box in enumerate(self._boxes):
                moment, distance = latest.get(agent, (0.0, 0.0))
                emitted = min(moment - self._start, step * self._dt)  # one that came meanwhile is of this step, too
                fresh = agent in latest and 0.0 < step * self._dt - emitted + self._dt < (_OLDEST + 1.0) * self._dt
                arrived = emitted + distance / self._speed
                box.send(k=step, emitted=emitted if fresh else None, arrived=arrived if fresh else None)
            step += 1
        self._over = self._over or step > self._length

    @property
    def begun(self) -> threading.Event:
        """Set when the run has begun."""
        return self._begun

    @property
    def heard(self) -> Heard:
        """What came so far."""
        return Heard(*self._counts)


def run_receiver(identity: Identity, source: str, form: str, say: Callable[[str], None]) -> Heard:
    """Feed a run from a source until the run is over. Raises UserError where source or run are none."""
    with Node(identity) as node:
        receiver = Receiver(node, form, paced=source.startswith("file:"))
        lines = lines_of(source, lambda: receiver.over)
        publishing = threading.Thread(target=receiver.publish, daemon=True)
        node.await_at_end(publishing)
        publishing.start()
        say(f"receiving from {source} for run {identity.run}")
        while source.startswith("file:") and not receiver.over and not receiver.begun.wait(0.1):
            pass
        for line in lines:
            receiver.take(line)
        while not receiver.over:
            time.sleep(0.1)
        return receiver.heard
