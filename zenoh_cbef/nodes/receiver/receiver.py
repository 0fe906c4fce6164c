"""The receiver process: ranges become beacons of a run; the steps are counted here, by the times of the source."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from math import inf

from zenoh_cbef.errors import UserError
from zenoh_cbef.nodes.common.briefing import brief
from zenoh_cbef.nodes.common.node import Identity, Node
from zenoh_cbef.nodes.common.readers import WINDOW
from zenoh_cbef.nodes.receiver.formats import FORMATS
from zenoh_cbef.nodes.receiver.laying import InStep, Laid, Latest, Offset
from zenoh_cbef.nodes.receiver.ranged import Found, Ranged, Reader
from zenoh_cbef.nodes.receiver.sources import Mark, bytes_of
from zenoh_cbef.protocol.fields import END, START
from zenoh_cbef.protocol.keys import agent_named
from zenoh_cbef.protocol.kinds import ESTIMATE, SIGNAL
from zenoh_cbef.protocol.mailbox import Mailbox
from zenoh_cbef.protocol.memory import ask_latest
from zenoh_cbef.protocol.messages import BadMessage, decode, peek, unpack

_PORTION = 0.1
_SOON = 0.002


@dataclass
class Heard:
    """What came from a source: ranges of the run's anchors, ranges of others, lines or messages without a range.

    late: ranges that came after their step, and so were of no use; in lockstep.
    """

    ranges: int = 0
    unknown: int = 0
    other: int = 0
    late: int = 0


class Receiver:
    """Lays ranges onto steps, and publishes beacons. paced: ranges are of a file, and wait until their own times."""

    def __init__(self, node: Node, *, paced: bool) -> None:
        self._node, self._paced = node, paced
        scenario = brief(node).scenario
        self.realtime = scenario.timing.mode == "realtime"
        self._scenario, self._dt, self._speed = scenario, scenario.dt, scenario.sensor.signal_speed
        self._agents = {name: agent for agent, name in enumerate(scenario.agents.names)}
        self._boxes = [node.outbox(node.keys.beacon(one), may_drop=self.realtime) for one in range(scenario.count)]
        node.archive.serve(node.keys.all_beacons)
        self._latest, self._laid, self._offset = Latest(scenario.count, self._dt), InStep(scenario), Offset()
        self._fixed: float | None = None
        self._lock, self._begun = threading.Lock(), threading.Event()
        self._start, self._over, self.heard = 0.0, False, Heard()
        self._reached = [0] * scenario.count
        node.follow(Mailbox(node.session, node.keys.all_signals), self._signal)
        if not self.realtime:
            node.follow(Mailbox(node.session, node.keys.all_estimates), self._estimate)
        for data in ask_latest(node.session, node.keys.signal(0)):
            self._signal(data)

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

    def _estimate(self, data: bytes) -> None:
        try:
            agent = agent_named(str(unpack(data).get("from")))
            if agent is not None and agent < len(self._reached):
                step = peek(ESTIMATE, data, run=self._node.identity.run, sender="")
                self._reached[agent] = max(self._reached[agent], step)
        except BadMessage:
            return

    def await_begin(self) -> None:
        """Wait until the run begins, or is over."""
        while not self.over and not self._begun.wait(_PORTION):
            pass

    def take(self, found: Found) -> None:
        """Take in what the source told. Raises UserError in lockstep, where it tells no times."""
        self.heard.other += found.other
        for one in found.ranges:
            agent = self._agents.get(one.anchor)
            if agent is None:
                self.heard.unknown += 1
                continue
            self.heard.ranges += 1
            if self.realtime:
                moment = self._moment(one)
                with self._lock:
                    self._latest.add(agent, moment, one.distance)
            elif one.time is None:
                raise UserError(
                    "in lockstep the times of the source say which step a range is of, and this one tells none; start "
                    "the target with --set timing.mode=realtime"
                )
            else:
                with self._lock:
                    self._laid.add(agent, one.time, one)

    def close(self, *, all_: bool) -> None:
        """In lockstep, no more ranges of the last step that has any will come; all_: nor of any other."""
        with self._lock:
            self._laid.close(all_=all_)

    def _moment(self, one: Ranged) -> float:
        """When a range was measured, s since 1970 on this host's clock; a receiver's own clock begins anywhere."""
        now = time.time()
        if one.time is None:
            return now
        if not self._paced:
            return min(now, one.time + self._offset.of(one.time, now))
        self._fixed = now - one.time if self._fixed is None else self._fixed
        while not self.over and (left := one.time + self._fixed - time.time()) > 0.0:
            time.sleep(min(left, _PORTION))
        return one.time + self._fixed

    def publish(self) -> None:
        """Publish a beacon for every agent and step, until the run is over."""
        self.await_begin()
        if self.realtime:
            self._in_time()
        else:
            self._in_step()
        self._over = True

    def _in_time(self) -> None:
        step = max(1, int((time.time() - self._start) / self._dt) + 1)
        while not self.over and step <= self._scenario.length:
            left = self._start + step * self._dt - time.time()
            if left > 0.0:
                time.sleep(min(left, _PORTION))
                continue
            with self._lock:
                laid = self._latest.take(step, self._start)
            self._send(step, laid)
            step += 1

    def _in_step(self) -> None:
        for step in range(1, self._scenario.length + 1):
            laid = None
            while not self.over and (laid is None or step > self._slowest() + WINDOW):
                with self._lock:
                    laid = self._laid.take() if laid is None else laid
                    self.heard.late = self._laid.late
                time.sleep(_SOON if laid is None or step > self._slowest() + WINDOW else 0.0)
            if self.over or laid is None:
                return
            self._send(step, laid)
        while not self.over:
            time.sleep(_PORTION)

    def _slowest(self) -> int:
        """The last step that all agents that are here have estimated."""
        names = self._node.presence.names()
        return min((self._reached[one] for one in range(len(self._reached)) if f"agent/{one}" in names), default=0)

    def _send(self, step: int, laid: Iterable[Laid | None]) -> None:
        for box, one in zip(self._boxes, laid, strict=True):
            arrived = None if one is None else one.emitted + one.distance / self._speed
            box.send(k=step, emitted=None if one is None else one.emitted, arrived=arrived)


def run_receiver(identity: Identity, source: str, form: str, silence: float, say: Callable[[str], None]) -> Heard:
    """Feed a run from a source until the run is over. Raises UserError where source or run are none.

    silence: after so many seconds without a byte, a run in lockstep goes on with what there is.
    """
    filed, reader = source.startswith("file:"), FORMATS[form]()
    heard = bytes_of(source, lambda: receiver.over)
    with Node(identity) as node:
        receiver = Receiver(node, paced=filed)
        publishing = threading.Thread(target=receiver.publish, daemon=True)
        node.await_at_end(publishing)
        publishing.start()
        say(f"receiving from {source} for run {identity.run}")
        if filed and receiver.realtime:
            receiver.await_begin()
        if filed and not receiver.realtime:
            receiver.take(_all_of(heard, reader))
            if not receiver.heard.ranges:
                raise UserError(f"{nothing_of(source, form, receiver.heard)}; the run waits for its ranges")
        else:
            _listen(receiver, heard, reader, silence)
        receiver.close(all_=filed)
        while not receiver.over:
            time.sleep(_PORTION)
        return receiver.heard


def nothing_of(source: str, form: str, heard: Heard) -> str:
    """What to say of a source that told no range of the run's anchors."""
    if heard.unknown:
        return f"{source} tells ranges of other anchors alone; name them in agents.labels"
    return f"{source} tells no range that --format {form} reads; name its format"


def _all_of(heard: Iterable[bytes | Mark], reader: Reader) -> Found:
    """All ranges of a file, in the order of their times, as a dataset has them."""
    pieces = [reader.finish() if isinstance(piece, Mark) else reader.feed(piece) for piece in heard]
    ranges = [one for piece in pieces for one in piece.ranges]
    timed = sorted(ranges, key=lambda one: -inf if one.time is None else one.time)
    return Found(timed, sum(piece.other for piece in pieces))


def _listen(receiver: Receiver, heard: Iterable[bytes | Mark], reader: Reader, silence: float) -> None:
    """Take in what comes, as it comes."""
    last = time.monotonic()
    for piece in heard:
        if piece is Mark.SILENT:
            if time.monotonic() - last > silence:
                receiver.close(all_=False)
            continue
        last = time.monotonic()
        if piece is Mark.BROKEN:
            reader.forget()
        else:
            receiver.take(reader.finish() if isinstance(piece, Mark) else reader.feed(piece))
