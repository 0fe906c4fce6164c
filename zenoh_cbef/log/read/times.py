"""When the messages of a log were sent, without what they say."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from zenoh_cbef.faults import ahead, clocks_of
from zenoh_cbef.log.mcap.contents import RawMessage
from zenoh_cbef.log.read.contents import Header
from zenoh_cbef.log.read.parts import Log
from zenoh_cbef.protocol.keys import Address, address
from zenoh_cbef.protocol.messages import BadMessage, decode
from zenoh_cbef.protocol.round_codec import RoundCodec


@dataclass
class MessageTimes:
    """Sending times, s since the start signal, of the first message of each kind.

    A message's turn is its step times one more than there are rounds, plus its round; ranges have round 0.
    beacons: by (agent, step), with whether one was heard. sends: ranges and consensus messages by (agent, turn).
    estimates: by (agent, step), with the message as it was encoded. events: (who, when, text).
    """

    turns: int
    beacons: dict[tuple[int, int], tuple[float, bool]] = field(default_factory=dict)
    sends: dict[tuple[int, int], float] = field(default_factory=dict)
    estimates: dict[tuple[int, int], tuple[float, bytes]] = field(default_factory=dict)
    events: list[tuple[str, float, str]] = field(default_factory=list)

    def used(self, agent: int, turn: int) -> float:
        """When an agent sent what followed from the messages of a turn; infinite where the log does not have it."""
        step, round_ = divmod(turn, self.turns)
        if round_ + 1 < self.turns:
            return self.sends.get((agent, turn + 1), math.inf)
        return self.estimates[agent, step][0] if (agent, step) in self.estimates else math.inf

    def steps(self) -> dict[int, tuple[float, float]]:
        """When the first agent began each step, and when the last one finished it."""
        found: dict[int, tuple[float, float]] = {}
        for (agent, step), (end, _) in self.estimates.items():
            begin = self.sends.get((agent, step * self.turns), end)
            first, last = found.get(step, (begin, end))
            found[step] = min(first, begin), max(last, end)
        return dict(sorted(found.items()))


def read_times(file: Log, header: Header) -> MessageTimes:
    """Read the times of all messages of a run; what is no message of it is passed over."""
    reader = _Reader(header)
    for raw in file.messages():
        try:
            reader.take(raw)
        except BadMessage:
            continue
    return reader.end()


class _Reader:
    def __init__(self, header: Header) -> None:
        scenario = header.scenario
        self._run, self._count, self._dt = header.run, scenario.count, scenario.dt
        width = header.plan.message_size
        self._codecs = [RoundCodec(header.run, f"agent/{agent}", width) for agent in range(self._count)]
        self._clocks = [clocks_of(scenario.fault, agent) for agent in range(self._count)]
        self._turns = header.plan.rounds + 1
        self._first: int | None = None
        self._start: int | None = None
        # All in nanoseconds: a log can hold what followed from the start signal before the signal itself.
        self._beacons: dict[tuple[int, int], tuple[int, bool]] = {}
        self._sends: dict[tuple[int, int], int] = {}
        self._estimates: dict[tuple[int, int], tuple[int, bytes]] = {}
        self._events: list[tuple[str, int, str]] = []

    def take(self, raw: RawMessage) -> None:
        """Take in one message. Raises BadMessage."""
        found = address(raw.channel.topic)
        if found is None or found.run != self._run or found.agent >= self._count:
            return
        if self._first is None:
            self._first = raw.publish_time
        if found.kind == "event":
            message = decode("event", raw.data, run=self._run)
            self._events.append((message["from"], raw.publish_time, message["text"]))
        elif found.kind in {"beacon", "signal"}:
            self._of_target(found, raw)
        elif found.kind in {"range", "round", "estimate"}:
            self._of_agent(found, raw)

    def end(self) -> MessageTimes:
        """The times, as all messages are known."""
        since = self._since
        return MessageTimes(
            self._turns,
            {name: (since(time), heard) for name, (time, heard) in self._beacons.items()},
            {name: since(time) for name, time in self._sends.items()},
            {name: (since(time), data) for name, (time, data) in self._estimates.items()},
            [(who, since(time), text) for who, time, text in self._events],
        )

    def _of_target(self, at: Address, raw: RawMessage) -> None:
        message = decode(at.kind, raw.data, run=self._run, sender=at.owner)
        if "signal" in message:
            if message["k"] == 0 and self._start is None:
                self._start = round(1e9 * message.get("at", 1e-9 * raw.publish_time))
        else:
            heard = message["emitted"] is not None and message["arrived"] is not None
            name = at.agent, message["k"]
            self._beacons.setdefault(name, (raw.publish_time, heard))

    def _of_agent(self, at: Address, raw: RawMessage) -> None:
        agent, kind = at.agent, at.kind
        if kind == "round":
            step, round_, *_ = self._codecs[agent].decode(raw.data)
        else:
            step, round_ = decode(kind, raw.data, run=self._run, sender=at.owner)["k"], 0
        # What the scenario's faults put a clock ahead by is known.
        time = raw.publish_time - round(1e9 * ahead(self._clocks[agent], step * self._dt))
        if kind == "estimate":
            self._estimates.setdefault((agent, step), (time, raw.data))
        else:
            self._sends.setdefault((agent, step * self._turns + round_), time)

    def _since(self, nanoseconds: int) -> float:
        return 1e-9 * (nanoseconds - (self._start or self._first or 0))
